"""A CycleGAN run: trained from beginning to end, or from where it was cut off; exported.

Pictures come closer to photographs the longer it goes on, and lines fade. So the newest generators
are kept that leave enough of the lines.
"""

import copy
from pathlib import Path
from typing import Any

import numpy as np
import torch
from rich.console import Console
from torch import nn

from robot.inference.policy import DIRECTIONS, TranslatorContract
from trainer.export import export_translator
from trainer.resumable import Loop
from trainer.transfer.cyclegan import Batch, CycleGan, TranslationConfig
from trainer.transfer.judge import LANE_OVERLAP, lanes_kept
from trainer.transfer.networks import PictureTranslator, as_floats, through
from trainer.transfer.pictures import SHEET_ROWS, draw_sheet, load_paint, load_pictures

JUDGE_EVERY = 125  # updates
JUDGED_EVERY = 8  # one picture of so many
_DUE = LANE_OVERLAP + 0.01  # since other pictures give other figures
_LARGEST_SHIFT = 0.05  # of the picture: photographs are cut a little differently each time


class UnpairedPictures:
    """Draws batches: simulated pictures with their paint, and photographs."""

    def __init__(self, config: TranslationConfig, device: torch.device) -> None:
        self.sim, self._real = (
            load_pictures([Path(folder) for folder in folders], config.image)
            for folders in (config.sim, config.real)
        )
        self._paint, self._device = load_paint(self.sim, config.image), device
        some = slice(None, None, JUDGED_EVERY)
        self._judged = self.sim.part(some), self._paint[some]

    def lanes_kept(self, translator: PictureTranslator) -> float:
        """As of `trainer.transfer.judge.lanes_kept`, of some of the pictures."""
        pictures, paint = self._judged
        return lanes_kept(pictures, paint, through(translator, pictures.images, self._device))

    def draw(self, count: int, rng: np.random.Generator) -> Batch:
        """So many of each."""
        sim, real = self.sim.draw(count, rng), self._real.draw(count, rng)
        photographs = np.stack([_shifted(self._real.images[k], rng) for k in real])
        parts = (self.sim.images[sim], photographs, self._paint[sim])
        first, second, paint = (torch.from_numpy(part).to(self._device) for part in parts)
        return Batch(as_floats(first), as_floats(second), paint.float() / 255.0)


class Newest:
    """The newest generators of a training that keep enough of the lines; else those of the most."""

    def __init__(self) -> None:
        self.lanes, self.steps = -1.0, 0  # updates until then
        self.weights: dict[str, Any] = {}

    def offer(self, lanes: float, generators: nn.Module, steps: int) -> None:
        """Keep a copy of the weights, if they are to be kept."""
        if lanes >= min(_DUE, self.lanes):
            self.lanes, self.steps = lanes, steps
            self.weights = copy.deepcopy(generators.state_dict())

    def state_dict(self) -> dict[str, Any]:
        """Plain data."""
        return dict(vars(self))

    def load_state_dict(self, state_dict: dict[str, Any], /) -> None:
        """Take it up again."""
        vars(self).update(state_dict)


def train_translation(out: Path, config: TranslationConfig, console: Console) -> Path:
    """Train until the steps are done; go on from a checkpoint if there is one.

    Leaves both translators as ONNX files, and ``sheet.png``; the path of sim-to-real. ConfigError
    if a folder of pictures is absent, empty or without labels.
    """
    on_gpu = config.device == "auto" and torch.cuda.is_available()
    device = torch.device("cuda" if on_gpu else "cpu")
    pictures, model = UnpairedPictures(config, device), CycleGan(config, device)
    newest = Newest()

    def step(rng: np.random.Generator, k: int) -> str:
        losses, done = model.step(pictures.draw(config.batch, rng), rng, k), k + 1
        if done % JUDGE_EVERY == 0 or done == config.steps:
            newest.offer(pictures.lanes_kept(PictureTranslator(model.kept[0])), model.kept, done)
        return f"cycle {losses['cycle']:.2f}, structure {losses['structure']:.2f}"

    parts = {**model.parts, "newest": newest}
    Loop(out / "checkpoint.pt", parts, config.steps, config.seed).run(step, "CycleGAN", console)
    model.kept.load_state_dict(newest.weights)
    generators = [PictureTranslator(each) for each in model.kept]
    for direction, generator in zip(DIRECTIONS, generators, strict=True):
        contract = TranslatorContract(
            "cyclegan", direction, config.image, out.resolve().name, newest.steps
        )
        export_translator(generator, contract, onnx_file(out, direction))
    given = pictures.sim.images[:: -(-len(pictures.sim.images) // SHEET_ROWS)]
    made = through(generators[0], given)
    back = through(generators[1], made)
    draw_sheet(out / "sheet.png", {"picture": given, "translation": made, "cycle": back})
    return onnx_file(out, DIRECTIONS[0])


def onnx_file(out: Path, direction: str) -> Path:
    """A run's translator in this direction, one of `robot.inference.policy.DIRECTIONS`."""
    return out / f"{direction.replace('-', '_')}.onnx"


def _shifted(picture: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Moved by a few pixels, the edge repeated: there are only some hundred photographs."""
    height, width = picture.shape[:2]
    most = max(1, round(_LARGEST_SHIFT * width))
    down, right = rng.integers(-most, most + 1, 2)
    rows = np.clip(np.arange(height) + down, 0, height - 1)
    columns = np.clip(np.arange(width) + right, 0, width - 1)
    return picture[rows][:, columns]
