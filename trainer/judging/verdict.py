"""What a driver did in a challenge: the Olympics' measures, medians over its episodes, how sure."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rich.console import Console
from rich.table import Table

from trainer.judging.challenge import SURVIVED, Episode
from trainer.judging.evaluate import wilson_low
from trainer.judging.films import Worst
from trainer.report.page import Picture, write_page

_DRAWS = 2000


class Estimate(NamedTuple):
    """A figure and its 95 % interval."""

    value: float
    low: float
    high: float


def share(successes: int, episodes: int) -> Estimate:
    """Of successes, with Wilson's interval."""
    low, high = wilson_low(successes, episodes), 1.0 - wilson_low(episodes - successes, episodes)
    return Estimate(successes / episodes, low, high)


def median(values: Sequence[float]) -> Estimate:
    """With the percentile bootstrap's interval (Efron 1979); the same again for the same values."""
    every = np.asarray(values, dtype=float)
    drawn = np.random.default_rng(0).integers(len(every), size=(_DRAWS, len(every)))
    low, high = np.quantile(np.median(every[drawn], axis=1), (0.025, 0.975)).tolist()
    return Estimate(float(np.median(every)), low, high)


class Pairing(NamedTuple):
    """Two drivers on the same episodes; ``p_value`` by McNemar's exact test, both sides."""

    only_first: int  # episodes that the first did and the second failed
    only_second: int
    p_value: float


def paired(first: Sequence[bool], second: Sequence[bool]) -> Pairing:
    """Compare two drivers by which episodes they did."""
    from scipy.stats import binomtest

    differ = [a for a, b in zip(first, second, strict=True) if a != b]
    if not differ:
        return Pairing(0, 0, 1.0)
    wins = sum(differ)
    return Pairing(wins, len(differ) - wins, float(binomtest(wins, len(differ)).pvalue))


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


def tell(console: Console, challenge: str, verdicts: Sequence[Verdict]) -> None:
    """A column for each driver, and who did better where there are two."""
    table = Table("", *(v.driver for v in verdicts), title=f"{challenge}, medians and 95 %")
    every = [verdict.figures for verdict in verdicts]
    for name in every[0]:
        told = ([round(figure, 2) + 0.0 for figure in each[name]] for each in every)  # no -0.00
        cells = [f"{value:.2f} ({low:.2f} to {high:.2f})" for value, low, high in told]
        table.add_row(f"{name} [{MEASURES[name]}]" if name in MEASURES else name, *cells)
    ends = [", ".join(f"{k} {n}" for k, n in v.ends.items()) or "none" for v in verdicts]
    table.add_row("infractions", *ends)
    console.print(table, markup=False)
    if len(verdicts) > 1:
        found = verdicts[0].against(verdicts[1])
        console.print(
            f"only {verdicts[0].driver} succeeded: {found['only_first']}, only "
            f"{verdicts[1].driver}: {found['only_second']}; McNemar p = {found['p_value']:.3g}"
        )


def write_worst(out: Path, worst: Worst, verdict: Verdict, challenge: str) -> Path:
    """Films of the worst of a verdict's episodes, and the page that shows them."""
    films = [Picture(name, "Its end.", path) for name, path in worst.write(out, "worst")]
    title = f"{verdict.driver}, {challenge}: {len(verdict.episodes)} episodes"
    rows = [(name, *(f"{x:.2f}" for x in each)) for name, each in verdict.figures.items()]
    write_page("judge.html", out / "judge.html", title=title, rows=rows, films=films)
    return out / "judge.html"
