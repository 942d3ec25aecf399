"""How well a translator does: closer to photographs, and lines where they were."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from robot.errors import ConfigError
from robot.inference.translator import OnnxTranslator
from trainer.transfer.metrics import bright_lines, features, kernel_distance, overlap
from trainer.transfer.pictures import Pictures, load_paint, load_pictures

LANE_OVERLAP = 0.85  # of the lines in picture and translation: what a translation must keep
_MARGIN = 0.01  # more than is due, since other pictures give other figures
FEWEST = 2  # pictures that a distance can be told from


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


class Judge:
    """Judges translators sim-to-real by pictures, their paint (`load_paint`) and photographs.

    ConfigError if there are too few of either.
    """

    def __init__(self, sim: Pictures, paint: np.ndarray, photographs: np.ndarray) -> None:
        if min(len(sim.images), len(photographs)) < FEWEST:
            raise ConfigError(
                f"translation: expected at least {2 * FEWEST} simulated pictures in a collection "
                f"and {2 * FEWEST} photographs of a drive, got too few to judge translations by"
            )
        self._real = features(photographs)
        self._parts = []
        for number in np.unique(sim.folder):
            mine = sim.folder == number
            found = bright_lines(sim.images[mine], paint[mine])
            self._parts.append((sim.images[mine], paint[mine], found))

    def score(self, translate: Callable[[np.ndarray], np.ndarray]) -> Score:
        """Of what makes of pictures (N, H, W, 3) uint8 others of the same size."""
        seen, kept = [], []
        for pictures, paint, found in self._parts:
            translated = translate(pictures)
            seen.append(features(translated))
            kept.append(overlap(bright_lines(translated, paint), found))
        return Score(kernel_distance(np.concatenate(seen), self._real), min(kept))

    def apart(self) -> float:
        """KID of every second photograph from the others: as close as it gets."""
        return kernel_distance(self._real[::2], self._real[1::2])


def judge(translator: OnnxTranslator, sim: Sequence[Path], real: Sequence[Path]) -> dict[str, Any]:
    """``--json`` of ``translate judge``: distances to photographs, and the lines kept.

    ``sim`` are collections from the simulator, best none that it was trained with.
    """
    simulated, photographs = (load_pictures(paths, translator.image) for paths in (sim, real))
    asked = Judge(simulated, load_paint(simulated, translator.image), photographs.images)
    before, after = asked.score(lambda pictures: pictures), asked.score(translator)
    return {
        "translator": str(translator.path),
        "pictures": len(simulated.images),
        "photographs": len(photographs.images),
        "kid_before": before.kid,
        "kid_after": after.kid,
        "kid_apart": asked.apart(),  # photographs from each other
        "lanes_kept": after.lanes,  # in the collection where it is least; LANE_OVERLAP is due
    }
