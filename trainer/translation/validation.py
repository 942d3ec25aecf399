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
from trainer.translation.bright_lines import bright_lines
from trainer.translation.cyclegan import CycleGan
from trainer.translation.distance import features, kernel_distance
from trainer.translation.lanes import overlap
from trainer.translation.networks import PictureTranslator
from trainer.translation.pictures import Pictures

LANE_OVERLAP = 0.85  # of the lines in picture and translation: what a translation must keep
_MARGIN = 0.01  # more than is due, since other pictures give other figures
HELD_OUT_EVERY = 8  # one picture of so many is not learned from
_FEWEST = 2  # pictures that a distance can be told from
_BATCH = 32


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


class Kept(NamedTuple):
    """The best generators so far; plain data, for the checkpoint."""

    score: tuple[float, ...]  # a `Score`
    steps: int  # updates until then
    to_real: dict[str, Any]
    to_sim: dict[str, Any]


def better(kept: Kept | None, score: Score, model: CycleGan) -> Kept:
    """What is kept once a training's newest generators have this score."""
    if kept is not None and not score.better_than(Score(*kept.score)):
        return kept
    weights = [copy.deepcopy(g.state_dict()) for g in (model.kept_to_real, model.kept_to_sim)]
    return Kept(tuple(score), model.steps, *weights)


class Validation:
    """Judges generators sim-to-real on pictures held out.

    Args:
        sim: simulated pictures.
        paint: their paint (N, 4, H, W), see `trainer.translation.pictures.load_paint`.
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
        translate = PictureTranslator(to_real)
        seen, kept = [], []
        for pictures, paint, found in self._parts:
            translated = _in_batches(translate, pictures, self._device)
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


def _in_batches(
    translate: PictureTranslator, pictures: np.ndarray, device: torch.device
) -> np.ndarray:
    parts = []
    with torch.no_grad():
        for first in range(0, len(pictures), _BATCH):
            part = torch.from_numpy(pictures[first : first + _BATCH]).to(device)
            parts.append(translate(part).cpu().numpy())
    return np.concatenate(parts)
