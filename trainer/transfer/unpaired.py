"""A CycleGAN run: trained from beginning to end, or from where it was cut off; exported."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from rich.console import Console

from robot.inference.translator import DIRECTIONS, TranslatorContract
from trainer.resumable import Loop, Stateful
from trainer.transfer.cyclegan import Batch, CycleGan, TranslationConfig
from trainer.transfer.export import export_translator
from trainer.transfer.metrics import through
from trainer.transfer.networks import PictureTranslator, as_floats
from trainer.transfer.pictures import SHEET_ROWS, draw_sheet, load_paint, load_pictures
from trainer.transfer.validation import Best, Validation, held_out, held_out_photographs

VALIDATE_EVERY = 125
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
        out, away = held_out(self.sim), held_out_photographs(self.real)
        self.validation = Validation(
            self.sim.part(out), self._paint[out], self.real.images[away], device
        )
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

    Leaves the best generators by the pictures held out as ONNX files, and ``sheet.png``.

    Raises:
        ConfigError: a folder of pictures is absent, empty or without labels.
        ContractError: torch and ONNX disagree.
    """
    torch.set_num_threads(config.threads)
    on_gpu = config.device == "auto" and torch.cuda.is_available()
    device = torch.device("cuda" if on_gpu else "cpu")
    pictures = UnpairedPictures(config, device)
    model, best = CycleGan(config, device), Best()

    def step(*_: object) -> str:
        losses = model.step(pictures.draw(config.batch, model.rng))
        if model.steps % VALIDATE_EVERY == 0 or model.steps == config.steps:
            best.offer(pictures.validation.score(model.kept_to_real), model)
        return f"cycle {losses['cycle']:.2f}, structure {losses['structure']:.2f}"

    parts: dict[str, Stateful] = {"model": model, "best": best}
    Loop(out / "checkpoint.pt", parts, config.steps, config.seed).run(step, "CycleGAN", console)
    generators = [PictureTranslator(each) for each in best.generators(model)]
    for direction, generator in zip(DIRECTIONS, generators, strict=True):
        contract = TranslatorContract(
            "cyclegan", direction, config.image, out.resolve().name, best.steps
        )
        export_translator(generator, contract, onnx_file(out, direction))
    given = pictures.sim.images[:: -(-len(pictures.sim.images) // SHEET_ROWS)]
    made = through(generators[0], given)
    back = through(generators[1], made)
    draw_sheet(out / "sheet.png", {"picture": given, "translation": made, "cycle": back})
    return best


def onnx_file(out: Path, direction: str) -> Path:
    """A run's translator in this direction, one of `robot.inference.translator.DIRECTIONS`."""
    return out / f"{direction.replace('-', '_')}.onnx"


def _shifted(picture: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Moved by a few pixels, the edge repeated: there are only some hundred photographs."""
    height, width = picture.shape[:2]
    most = max(1, round(_LARGEST_SHIFT * width))
    down, right = rng.integers(-most, most + 1, 2)
    rows = np.clip(np.arange(height) + down, 0, height - 1)
    columns = np.clip(np.arange(width) + right, 0, width - 1)
    return picture[rows][:, columns]
