"""Tables 4 and 5 of paper A, and the learning curves of its Figures 36 to 39."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import mean, median, stdev

from rich.table import Table as RichTable

from trainer.algorithms import find_algorithm
from trainer.experiments.six_models import (
    ALGORITHMS,
    VARIANTS,
    Model,
    SixModelsOptions,
    episodes,
    models,
    of_kind,
)
from trainer.report.curves import draw_panels
from trainer.run import RunFolder
from trainer.training.checkpoint import read_state

# Of 32 paths and of 50 missions; the models that are not named failed (fewer than 10 paths).
PAPER = {("dueling", "cyclegan"): (27, 31), ("ppo", "cyclegan"): (24, 26)}
SUCCESS_ABOVE, FAILURE_BELOW = 20, 10  # paths

# Student's t at 97.5 %, of the mean of 2, 3, 4 ... values; the last serves for more.
_STUDENT = (12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262)


@dataclass(frozen=True)
class TransferRow:
    """Models that differ by their seeds only, in the order of the seeds."""

    algorithm: str
    variant: str
    laps: tuple[int, ...]  # drives of four laps without leaving the lane
    paths: tuple[int, ...]
    tasks: tuple[int, ...]

    @property
    def verdict(self) -> str:
        """The paper's, on the median model: more than 20 of 32 paths, or fewer than 10."""
        paths = median(self.paths)
        if paths > SUCCESS_ABOVE:
            return "success"
        return "failure" if paths < FAILURE_BELOW else "neither"


@dataclass(frozen=True)
class Transfer:
    """What the experiment writes as JSON."""

    options: SixModelsOptions
    episodes: dict[str, int]
    rows: tuple[TransferRow, ...]
    schema: int = 1


def gather(out: Path, options: SixModelsOptions) -> Transfer:
    """The figures of all tests; they must have been run."""
    everyone = models(options)
    rows = []
    for variant in VARIANTS:
        for algorithm in ALGORITHMS:
            kind = of_kind(everyone, algorithm, variant)
            if kind:
                counts = [
                    tuple(_successes(m, out, test) for m in kind) for test in episodes(options)
                ]
                rows.append(TransferRow(algorithm, variant, *counts))
    return Transfer(options, episodes(options), tuple(rows))


def table_rows(transfer: Transfer) -> list[tuple[str, ...]]:
    """Both of the paper's tables in one, its figures beside ours; the first row says what is what.

    Ours are each seed's, with the 95 % interval of their mean.
    """
    laps, paths, tasks = (f"of {count}" for count in transfer.episodes.values())
    rows: list[tuple[str, ...]] = [
        (
            "transfer",
            "algorithm",
            f"four laps {laps}",
            f"paths {paths}",
            "verdict",
            "paper",
            f"missions {tasks}",
            "paper",
        )
    ]
    for row in transfer.rows:
        theirs = PAPER.get((row.algorithm, row.variant))
        rows.append(
            (
                VARIANTS[row.variant].title,
                find_algorithm(row.algorithm).title,
                _each(row.laps),
                _each(row.paths),
                row.verdict,
                str(theirs[0]) if theirs else _paper_verdict(row),
                _each(row.tasks),
                str(theirs[1]) if theirs else "–",
            )
        )
    return rows


def as_table(transfer: Transfer) -> RichTable:
    """`table_rows` for the terminal."""
    head, *rows = table_rows(transfer)
    table = RichTable(*head, title=f"judged in {transfer.options.look}")
    for row in rows:
        table.add_row(*row)
    return table


def draw_transfer_curves(out: Path, options: SixModelsOptions, path: Path) -> None:
    """A panel for each kind of navigator, mean and band over its seeds."""
    everyone, panels = models(options), []
    for variant, (title, _, _) in VARIANTS.items():
        for algorithm in ALGORITHMS:
            runs = [
                RunFolder(m.run(out, "navigation")) for m in of_kind(everyone, algorithm, variant)
            ]
            if runs:
                records = [(run.episodes(), read_state(run.checkpoint).evaluations) for run in runs]
                panels.append((f"{find_algorithm(algorithm).title}, transfer by {title}", records))
    draw_panels(panels, path)


def _successes(model: Model, out: Path, test: str) -> int:
    found = json.loads(model.judged(out, test).read_text(encoding="utf-8"))
    return int(found["episodes"]) - len(found["failures"])


def _each(counts: tuple[int, ...]) -> str:
    seeds = ", ".join(map(str, counts))
    if len(counts) < 2:
        return seeds
    return f"{seeds} ({mean(counts):.1f} ± {half_interval(counts):.1f})"


def half_interval(values: Sequence[float]) -> float:
    """Half of the 95 % interval of the mean of two values or more, by Student's t (1908)."""
    quantile = _STUDENT[min(len(values), len(_STUDENT) + 1) - 2]
    return quantile * stdev(values) / math.sqrt(len(values))


def _paper_verdict(row: TransferRow) -> str:
    return "failure" if row.variant in ("none", "dr") else "–"
