"""A CycleGAN run: trained from beginning to end, or from where it was cut off; exported."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from rich.console import Console
from torch.utils.tensorboard import SummaryWriter

from robot.errors import ConfigError
from robot.inference.translator import DIRECTIONS, TranslatorContract
from trainer.resumable import Loop, Stateful
from trainer.run import read_run
from trainer.transfer.cyclegan import Batch, CycleGan, TranslationConfig
from trainer.transfer.export import export_translator
from trainer.transfer.networks import PictureTranslator, as_floats
from trainer.transfer.pictures import load_paint, load_pictures
from trainer.transfer.validation import Best, Validation, held_out, held_out_photographs

VALIDATE_EVERY = 125
_LOG_EVERY = 20
_LARGEST_SHIFT = 0.05  # of the picture: photographs are cut a little differently each time


class UnpairedPictures:
    """Draws batches: simulated pictures with their paint, and photographs.

    ``validation`` judges by simulated pictures and photographs that are not drawn.
    """

    def __init__(self, config: TranslationConfig, device: torch.device) -> None:
        self.sim, self.real = (
            load_pictures([Path(folder) for folder in folders], config.image)
            for folders in (config.sim, config.real)
        )
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
        parts = (self.sim.images[sim], photographs, self._paint[sim])
        first, second, paint = (torch.from_numpy(part).to(self._device) for part in parts)
        return Batch(as_floats(first), as_floats(second), paint.float() / 255.0)


def train_translation(out: Path, config: TranslationConfig, console: Console) -> Best:
    """Train until the steps are done; go on from a checkpoint if there is one.

    Returns:
        The best generators by the pictures held out, which are those that are exported.

    Raises:
        ConfigError: a folder of pictures is absent, empty or without labels.
    """
    torch.set_num_threads(config.threads)
    auto = "cuda" if torch.cuda.is_available() else "cpu"
    device = torch.device(auto if config.device == "auto" else config.device)
    pictures = UnpairedPictures(config, device)
    model, best, loop = _parts(out, config, device)
    with SummaryWriter(str(out / "tensorboard"), purge_step=loop.done()) as writer:

        def step(*_: object) -> str:
            losses = model.step(pictures.draw(config.batch, model.rng))
            if model.steps % _LOG_EVERY == 0:
                _log(writer, "loss", losses, model.steps)
            if model.steps % VALIDATE_EVERY == 0 or model.steps == config.steps:
                score = pictures.validation.score(model.kept_to_real)
                best.offer(score, model)
                _log(writer, "validation", score._asdict(), model.steps)
            return f"cycle {losses['cycle']:.2f}, structure {losses['structure']:.2f}"

        loop.run(step, "CycleGAN", console)
    return best


def export_translators(out: Path) -> list[Path]:
    """Write both directions of a run's best generators so far, or of its first; their paths.

    Raises:
        ConfigError: no run, or no checkpoint yet.
        ContractError: torch and ONNX disagree.
    """
    model, best, loop = _parts(out, read_run(TranslationConfig, out), torch.device("cpu"))
    if not loop.path.exists():
        raise ConfigError(f"{out}: expected a checkpoint, found none; train first")
    loop.done()
    generators = (model.kept_to_real, model.kept_to_sim)
    for generator, weights in zip(generators, best.weights, strict=False):
        generator.load_state_dict(weights)
    steps = best.steps if best.score else model.steps
    for direction, generator in zip(DIRECTIONS, generators, strict=True):
        image, name = model.config.image, out.resolve().name
        contract = TranslatorContract("cyclegan", direction, image, name, steps)
        export_translator(PictureTranslator(generator), contract, onnx_file(out, direction))
    return [onnx_file(out, direction) for direction in DIRECTIONS]


def onnx_file(out: Path, direction: str) -> Path:
    """A run's translator in this direction, one of `robot.inference.translator.DIRECTIONS`."""
    return out / f"{direction.replace('-', '_')}.onnx"


def _parts(
    out: Path, config: TranslationConfig, device: torch.device
) -> tuple[CycleGan, Best, Loop]:
    model, best = CycleGan(config, device), Best()
    parts: dict[str, Stateful] = {"model": model, "best": best}
    return model, best, Loop(out / "checkpoint.pt", parts, config.steps, config.seed)


def _log(writer: SummaryWriter, group: str, figures: dict[str, float], steps: int) -> None:
    for name, figure in figures.items():
        writer.add_scalar(f"{group}/{name}", figure, steps)


def _shifted(picture: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Moved by a few pixels, the edge repeated: there are only some hundred photographs."""
    height, width = picture.shape[:2]
    most = max(1, round(_LARGEST_SHIFT * width))
    down, right = rng.integers(-most, most + 1, 2)
    rows = np.clip(np.arange(height) + down, 0, height - 1)
    columns = np.clip(np.arange(width) + right, 0, width - 1)
    return picture[rows][:, columns]
