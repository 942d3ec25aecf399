"""A CycleGAN run: trained from beginning to end, or from where it was cut off; exported.

More updates are not always better: pictures come closer to photographs and drift away again, and
lines fade. So the best generators are kept, judged on pictures that none of them learned from.
"""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import numpy as np
import torch
from rich.console import Console
from torch import nn

from robot.inference.translator import DIRECTIONS, TranslatorContract
from trainer.export import export_translator
from trainer.resumable import Loop
from trainer.transfer.cyclegan import Batch, CycleGan, TranslationConfig
from trainer.transfer.judge import FEWEST, Judge, Score
from trainer.transfer.labelled import ends
from trainer.transfer.networks import PictureTranslator, as_floats, through
from trainer.transfer.pictures import SHEET_ROWS, Pictures, draw_sheet, load_paint, load_pictures

JUDGE_EVERY = 125
HELD_OUT_EVERY = 8  # one picture of so many is not learned from
_LARGEST_SHIFT = 0.05  # of the picture: photographs are cut a little differently each time


class UnpairedPictures:
    """Draws batches: simulated pictures with their paint, and photographs.

    ``judge`` has the simulated pictures and photographs that are not drawn.
    """

    def __init__(self, config: TranslationConfig, device: torch.device) -> None:
        self.sim, self.real = (
            load_pictures([Path(folder) for folder in folders], config.image)
            for folders in (config.sim, config.real)
        )
        self._paint = load_paint(self.sim, config.image)
        self._device = device
        out, away = held_out(self.sim), held_out_photographs(self.real)
        self.judge = Judge(self.sim.part(out), self._paint[out], self.real.images[away])
        self.sim, self._paint = self.sim.part(~out), self._paint[~out]
        self.real = self.real.part(~away)

    def draw(self, count: int, rng: np.random.Generator) -> Batch:
        """So many of each."""
        sim, real = self.sim.draw(count, rng), self.real.draw(count, rng)
        photographs = np.stack([_shifted(self.real.images[k], rng) for k in real])
        parts = (self.sim.images[sim], photographs, self._paint[sim])
        first, second, paint = (torch.from_numpy(part).to(self._device) for part in parts)
        return Batch(as_floats(first), as_floats(second), paint.float() / 255.0)


class Best:
    """The best generators of a training so far."""

    def __init__(self) -> None:
        self.score: Score | None = None
        self.steps = 0  # updates until then
        self.weights: list[dict[str, Any]] = []  # of sim-to-real, real-to-sim

    def offer(self, score: Score, model: CycleGan) -> None:
        """Keep the newest generators, which have this score, if none so far were better."""
        if score.better_than(self.score):
            self.score, self.steps = score, model.steps
            self.weights = [copy.deepcopy(each.state_dict()) for each in model.kept]

    def generators(self, model: CycleGan) -> tuple[nn.Module, nn.Module]:
        """Sim-to-real and real-to-sim with the weights kept, in place of the model's newest."""
        for generator, weights in zip(model.kept, self.weights, strict=True):
            generator.load_state_dict(weights)
        return model.kept_to_real, model.kept_to_sim

    def state_dict(self) -> dict[str, Any]:
        """Plain data."""
        return {**vars(self), "score": self.score and tuple(self.score)}

    def load_state_dict(self, state_dict: dict[str, Any], /) -> None:
        """Take it up again."""
        vars(self).update(state_dict)
        self.score = self.score and Score(*self.score)


def train_translation(out: Path, config: TranslationConfig, console: Console) -> Best:
    """Train until the steps are done; go on from a checkpoint if there is one.

    Leaves the best generators by the pictures held out as ONNX files, and ``sheet.png``.
    ConfigError if a folder of pictures is absent, empty or without labels.
    """
    on_gpu = config.device == "auto" and torch.cuda.is_available()
    device = torch.device("cuda" if on_gpu else "cpu")
    pictures = UnpairedPictures(config, device)
    model, best = CycleGan(config, device), Best()

    def step(*_: object) -> str:
        losses = model.step(pictures.draw(config.batch, model.rng))
        if model.steps % JUDGE_EVERY == 0 or model.steps == config.steps:
            kept = PictureTranslator(model.kept_to_real)
            best.offer(pictures.judge.score(lambda some: through(kept, some, device)), model)
        return f"cycle {losses['cycle']:.2f}, structure {losses['structure']:.2f}"

    parts = {"model": model, "best": best}
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


def held_out(sim: Pictures) -> np.ndarray:
    """(N,) bool: spread over every collection of two pictures or more."""
    chosen = np.zeros(len(sim.images), bool)
    for number in np.unique(sim.folder):
        mine = np.flatnonzero(sim.folder == number)
        chosen[mine[1 :: min(HELD_OUT_EVERY, max(2, len(mine) // FEWEST))]] = True
    return chosen


def held_out_photographs(real: Pictures) -> np.ndarray:
    """(N,) bool: the end of every drive of every folder, see `ends`.

    Neighbours in a drive look alike, so photographs here and there would not be strangers.
    """
    chosen = np.zeros(len(real.images), bool)
    for number in np.unique(real.folder):
        mine = np.flatnonzero(real.folder == number)
        names = [real.files[i].stem for i in mine]
        chosen[mine] = ends(names, 1.0 / HELD_OUT_EVERY, FEWEST)
    return chosen


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
