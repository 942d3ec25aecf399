"""What a driver did in a challenge: the Olympics' measures, medians over its episodes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from trainer.judging.challenge import SURVIVED, Episode
from trainer.judging.statistics import Estimate, median, paired, share

# Units of `LaneFigures`, whose names are the Olympics' with underscores, in the order of a table.
MEASURES = {
    "survival_time": "s",
    "driven_lanedir_consec": "m",
    "deviation-center-line": "m s",
    "in-drivable-lane": "s",
    "deviation-heading": "rad s",
    "distance-from-start": "m",
}


@dataclass(frozen=True)
class Verdict:
    """One driver's."""

    driver: str
    episodes: Sequence[Episode]

    @property
    def figures(self) -> dict[str, Estimate]:
        """Shares, and medians by the Olympics' names.

        A collision counts that is its own fault; to survive without three tiles is no success.
        """
        every = self.episodes
        measures = {
            name: median([getattr(e.figures, name.replace("-", "_")) for e in every])
            for name in MEASURES
        }
        return {
            "collision_free_rate": share(sum(not e.at_fault for e in every), len(every)),
            "success_rate": share(sum(e.success for e in every), len(every)),
            "tiles": median([e.tiles for e in every]),
            **measures,
            "least_time_to_collision": median([e.least_ttc_s for e in every]),
        }

    @property
    def ends(self) -> dict[str, int]:
        """What ended episodes before their time, whose fault it was, red lines run; how many."""
        found: Counter[str] = Counter()
        for each in self.episodes:
            if each.end != SURVIVED:
                others = each.end.startswith("collision") and not each.at_fault
                found[each.end + "_by_others" * others] += 1
            found["line_run"] += each.lines_run
        return {name: count for name, count in sorted(found.items()) if count}

    def plain(self) -> dict[str, Any]:
        """For JSON."""
        rows = [{**each._asdict(), "figures": each.figures._asdict()} for each in self.episodes]
        return {
            "driver": self.driver,
            **{name: found.value for name, found in self.figures.items()},
            "intervals": {name: [found.low, found.high] for name, found in self.figures.items()},
            "infractions": self.ends,
            "drives": rows,
        }

    def against(self, other: Verdict) -> dict[str, Any]:
        """Both on the same episodes: who succeeded where the other did not."""
        mine, theirs = ([e.success for e in v.episodes] for v in (self, other))
        return {**other.plain(), **paired(mine, theirs)._asdict()}
