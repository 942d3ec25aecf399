"""What a driver did in a challenge: the Olympics' measures, medians over its episodes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from trainer.judging.challenge import SURVIVED, Episode
from trainer.judging.statistics import Estimate, median, paired, share

# Of `LaneFigures`, as the Olympics write them, in the order of a table.
MEASURES = {
    "survival_time": ("survival_time", "s"),
    "driven_lanedir_consec": ("driven_lanedir_consec", "m"),
    "deviation-center-line": ("deviation_center_line", "m s"),
    "in-drivable-lane": ("in_drivable_lane", "s"),
    "deviation-heading": ("deviation_heading", "rad s"),
    "distance-from-start": ("distance_from_start", "m"),
}


@dataclass(frozen=True)
class Verdict:
    """One driver's."""

    driver: str
    episodes: Sequence[Episode]

    @property
    def collision_free(self) -> Estimate:
        """Share of the episodes without a collision of its own."""
        return share(sum(not e.collided for e in self.episodes), len(self.episodes))

    @property
    def tiles(self) -> Estimate:
        """Driven along the lane, the median."""
        return median([episode.tiles for episode in self.episodes])

    @property
    def measures(self) -> dict[str, Estimate]:
        """Medians by the Olympics' names."""
        return {
            name: median([getattr(e.figures, key) for e in self.episodes])
            for name, (key, _) in MEASURES.items()
        }

    @property
    def ends(self) -> dict[str, int]:
        """What ended episodes before their time, and how many."""
        return dict(sorted(Counter(e.end for e in self.episodes if e.end != SURVIVED).items()))

    def plain(self) -> dict[str, Any]:
        """For JSON."""
        every = {"collision_free_rate": self.collision_free, "tiles": self.tiles, **self.measures}
        rows = [
            {**each._asdict(), "figures": each.figures._asdict(), "collided": each.collided}
            for each in self.episodes
        ]
        return {
            "driver": self.driver,
            **{name: found.value for name, found in every.items()},
            "intervals": {name: [found.low, found.high] for name, found in every.items()},
            "infractions": self.ends,
            "drives": rows,
        }

    def against(self, other: Verdict) -> dict[str, Any]:
        """Both on the same episodes: who survived the minute where the other did not."""
        mine, theirs = ([e.end == SURVIVED for e in v.episodes] for v in (self, other))
        return {**other.plain(), **paired(mine, theirs)._asdict()}
