"""Which of a training's translators is kept: judged on pictures that it did not learn from.

Critics and generators chase each other, and more updates are not always better: the pictures come
closer to photographs and then drift away again, and lines fade or are drawn anew.
"""

from __future__ import annotations

import copy
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import nn

from robot.errors import ConfigError
from trainer.sequences import ends
from trainer.transfer.cyclegan import CycleGan
from trainer.transfer.metrics import bright_lines, features, kernel_distance, overlap, through
from trainer.transfer.networks import PictureTranslator
from trainer.transfer.pictures import Pictures

LANE_OVERLAP = 0.85  # of the lines in picture and translation: what a translation must keep
_MARGIN = 0.01  # more than is due, since other pictures give other figures
HELD_OUT_EVERY = 8  # one picture of so many is not learned from
_FEWEST = 2  # pictures that a distance can be told from


class Score(NamedTuple):
    """How good a translator sim-to-real is."""

    kid: float  # distance to the photographs, of all collections together
    lanes: float  # lines kept, in the collection where it is least

    def better_than(self, other: Score | None) -> bool:
        """Closer to photographs, among those that keep enough lines; else by the lines kept."""
        if other is None:
            return True
        due = LANE_OVERLAP + _MARGIN
        if min(self.lanes, other.lanes) >= due:
            return self.kid < other.kid
        return self.lanes > other.lanes


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


class Validation:
    """Judges generators sim-to-real on pictures held out.

    Args:
        sim: simulated pictures.
        paint: their paint (N, 4, H, W), see `load_paint`.
        real: photographs (M, H, W, 3) uint8, held out as well.
        device: of the generators.

    Raises:
        ConfigError: too few of either.
    """

    def __init__(
        self, sim: Pictures, paint: np.ndarray, real: np.ndarray, device: torch.device
    ) -> None:
        if min(len(sim.images), len(real)) < _FEWEST:
            raise ConfigError(
                f"translation: expected at least {2 * _FEWEST} simulated pictures in a collection "
                f"and {2 * _FEWEST} photographs of a drive, got too few to judge translations by"
            )
        self._device = device
        self._real = features(real)
        self._parts = []
        for number in np.unique(sim.folder):
            mine = sim.folder == number
            found = bright_lines(sim.images[mine], paint[mine])
            self._parts.append((sim.images[mine], paint[mine], found))

    def score(self, to_real: nn.Module) -> Score:
        """Of a generator as it is now."""
        translator, seen, kept = PictureTranslator(to_real), [], []
        for pictures, paint, found in self._parts:
            translated = through(translator, pictures, self._device)
            seen.append(features(translated))
            kept.append(overlap(bright_lines(translated, paint), found))
        return Score(kernel_distance(np.concatenate(seen), self._real), min(kept))


def held_out(sim: Pictures) -> np.ndarray:
    """(N,) bool: spread over every collection of two pictures or more."""
    chosen = np.zeros(len(sim.images), bool)
    for number in np.unique(sim.folder):
        mine = np.flatnonzero(sim.folder == number)
        chosen[mine[1 :: min(HELD_OUT_EVERY, max(2, len(mine) // _FEWEST))]] = True
    return chosen


def held_out_photographs(real: Pictures) -> np.ndarray:
    """(N,) bool: the end of every drive of every folder, see `trainer.sequences`.

    Neighbours in a drive look alike, so photographs here and there would not be strangers.
    """
    chosen = np.zeros(len(real.images), bool)
    for number in np.unique(real.folder):
        mine = np.flatnonzero(real.folder == number)
        names = [real.files[i].stem for i in mine]
        chosen[mine] = ends(names, 1.0 / HELD_OUT_EVERY, _FEWEST)
    return chosen
