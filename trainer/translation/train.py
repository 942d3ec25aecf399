"""A CycleGAN training from beginning to end, or from where it was cut off."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch.utils.tensorboard import SummaryWriter
from tqdm import tqdm

from trainer.translation.config import TranslationConfig
from trainer.translation.cyclegan import Batch, CycleGan
from trainer.translation.folder import TranslationFolder
from trainer.translation.networks import as_bytes, as_floats
from trainer.translation.pictures import Pictures, load_paint, load_pictures
from trainer.translation.validation import Kept, Validation, better, held_out, held_out_photographs

SHOWN = 4  # columns of a sample grid
VALIDATE_EVERY = 125
_LOG_EVERY = 20
_LARGEST_SHIFT = 0.05  # of the picture: photographs are cut a little differently each time


class UnpairedPictures:
    """Draws batches: simulated pictures with their paint, and photographs.

    ``validation`` judges by simulated pictures and photographs that are not drawn.
    """

    def __init__(self, config: TranslationConfig, device: torch.device) -> None:
        self.sim = load_pictures([Path(folder) for folder in config.sim], config.image)
        self.real = load_pictures([Path(folder) for folder in config.real], config.image)
        self._paint = load_paint(self.sim, config.image)
        self._device = device
        out = held_out(self.sim)
        away = held_out_photographs(self.real)
        strangers = self.real.images[away]
        self.validation = Validation(self.sim.part(out), self._paint[out], strangers, device)
        self.sim, self._paint = self.sim.part(~out), self._paint[~out]
        self.real = self.real.part(~away)

    def draw(self, count: int, rng: np.random.Generator) -> Batch:
        """So many of each."""
        sim, real = self.sim.draw(count, rng), self.real.draw(count, rng)
        photographs = np.stack([_shifted(self.real.images[k], rng) for k in real])
        return self._batch(self.sim.images[sim], photographs, self._paint[sim])

    def shown(self) -> Batch:
        """The pictures of the sample grids, always the same."""
        sim, real = (_spread(pictures, SHOWN) for pictures in (self.sim, self.real))
        return self._batch(self.sim.images[sim], self.real.images[real], self._paint[sim])

    def _batch(self, sim: np.ndarray, real: np.ndarray, paint: np.ndarray) -> Batch:
        device = self._device
        return Batch(
            as_floats(torch.from_numpy(sim).to(device)),
            as_floats(torch.from_numpy(real).to(device)),
            torch.from_numpy(paint).to(device).float() / 255.0,
        )


def train_translation(
    folder: TranslationFolder,
    config: TranslationConfig,
    save_period_s: float = 60.0,
    clock: Callable[[], float] = time.monotonic,
) -> Kept:
    """Train until the steps are done; go on from a checkpoint if there is one.

    Returns:
        The best generators by the pictures held out, which are those that are exported.

    Raises:
        ConfigError: a folder of pictures is absent, empty or without labels.
    """
    torch.set_num_threads(config.threads)
    device = torch.device(chosen_device(config.device))
    pictures = UnpairedPictures(config, device)
    model, kept = CycleGan(config, device), None
    if folder.checkpoint.exists():
        model, kept = _restored(model, folder.load(device))
    writer = SummaryWriter(str(folder.tensorboard), purge_step=model.steps)
    saved_s = clock()
    bar = tqdm(total=config.steps, initial=model.steps, unit="step", dynamic_ncols=True)
    try:
        while model.steps < config.steps:
            losses = model.step(pictures.draw(config.batch, model.rng))
            bar.update()
            if model.steps % _LOG_EVERY == 0:
                bar.set_postfix({k: f"{losses[k]:.2f}" for k in ("cycle", "structure")})
                for name, loss in losses.items():
                    writer.add_scalar(f"loss/{name}", loss, model.steps)
            if model.steps % VALIDATE_EVERY == 0 or model.steps == config.steps:
                kept = _validated(model, kept, pictures, writer)
            if clock() - saved_s > save_period_s:
                folder.save(_state(model, kept))
                _show(writer, model, pictures.shown())
                saved_s = clock()
    finally:
        folder.save(_state(model, kept))
        bar.close()
        writer.close()
    return kept or better(None, pictures.validation.score(model.kept_to_real), model)


def load_kept(folder: TranslationFolder) -> tuple[CycleGan, Kept | None]:
    """The networks of a run as its checkpoint has them, on the processor, with the best so far.

    Raises:
        ConfigError: no run, or no checkpoint yet.
    """
    device = torch.device("cpu")
    return _restored(CycleGan(folder.load_config(), device), folder.load(device))


def _validated(
    model: CycleGan, kept: Kept | None, pictures: UnpairedPictures, writer: SummaryWriter
) -> Kept:
    score = pictures.validation.score(model.kept_to_real)
    for name, figure in score._asdict().items():
        writer.add_scalar(f"validation/{name}", figure, model.steps)
    return better(kept, score, model)


def _state(model: CycleGan, kept: Kept | None) -> dict[str, Any]:
    return {**model.state(), "kept": tuple(kept) if kept else None}


def _restored(model: CycleGan, state: dict[str, Any]) -> tuple[CycleGan, Kept | None]:
    model.restore(state)
    kept = state["kept"]
    return model, Kept(*kept) if kept else None


def chosen_device(name: str) -> str:
    """``auto`` is the graphics card where there is one."""
    if name != "auto":
        return name
    return "cuda" if torch.cuda.is_available() else "cpu"


def _show(writer: SummaryWriter, model: CycleGan, batch: Batch) -> None:
    """Rows: picture, translation, cycle."""
    with torch.no_grad():
        to_real, to_sim = model.kept_to_real, model.kept_to_sim
        there, back = to_real(batch.sim), to_sim(batch.real)
        rows = {
            "sim-to-real": (batch.sim, there, to_sim(there)),
            "real-to-sim": (batch.real, back, to_real(back)),
        }
    for name, parts in rows.items():
        grid = np.vstack([np.hstack(list(as_bytes(part).cpu().numpy())) for part in parts])
        writer.add_image(name, grid, model.steps, dataformats="HWC")


def _spread(pictures: Pictures, count: int) -> np.ndarray:
    return np.linspace(0, len(pictures.images) - 1, count).astype(int)


def _shifted(picture: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Moved by a few pixels, the edge repeated: there are only some hundred photographs."""
    height, width = picture.shape[:2]
    most = max(1, round(_LARGEST_SHIFT * width))
    down, right = rng.integers(-most, most + 1, 2)
    rows = np.clip(np.arange(height) + down, 0, height - 1)
    columns = np.clip(np.arange(width) + right, 0, width - 1)
    return picture[rows][:, columns]
