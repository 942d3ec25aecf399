"""Many trainings or evaluations with one command: seeds, and options crossed with each other."""

from __future__ import annotations

import itertools
import os
import re
from collections.abc import Sequence
from concurrent import futures
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn

from robot.command_line import INTERRUPTED
from robot.errors import ConfigError
from robot.typed_config import from_plain, read_yaml, to_plain
from trainer.sweeps.workers import Job, LocalWorkers, Outcome, RayWorkers, Workers

T = TypeVar("T")
PERIOD_S = 0.5  # between looks at how the jobs are doing


@dataclass(frozen=True)
class WorkerOptions:
    """Who does many jobs."""

    workers: int | None = None
    """Processes at once; else one for each core."""
    ray: str | None = None
    """On a Ray cluster: its address, or auto. All its nodes must share this folder."""


@dataclass(frozen=True)
class SweepOptions(WorkerOptions):
    """Several runs in the place of one."""

    seeds: int | None = None
    """So many, with the seeds from --seed on; those that are finished are skipped."""
    matrix: Path | None = None
    """A YAML file of options, each with a list of values: all combinations."""

    @property
    def wanted(self) -> bool:
        """Whether any were asked for."""
        return self.seeds is not None or self.matrix is not None or self.ray is not None


def combinations(options: T, many: SweepOptions, seed_step: int = 1) -> list[tuple[str, T]]:
    """Every combination of what is to vary: a name that tells what is its own, and its options.

    Args:
        options: a frozen dataclass; what does not vary.
        many: which seeds, and the file with everything else.
        seed_step: from one of ``--seeds`` to the next.

    Raises:
        ConfigError: an unknown option, a value of the wrong kind, or two equal combinations.
    """
    choices = _choices(options, many, seed_step)
    found: dict[str, T] = {}
    for values in itertools.product(*choices.values()):
        chosen = dict(zip(choices, values, strict=True))
        name = "_".join(f"{key}-{_slug(value)}" for key, value in chosen.items())
        if name in found:
            raise ConfigError(f"{many.matrix}: expected different values, got {name} twice")
        plain = {**to_plain(options), **chosen}
        found[name] = from_plain(type(options), plain, where=str(many.matrix or "options"))
    return list(found.items())


def run_sweep(jobs: Sequence[Job], many: WorkerOptions, console: Console) -> int:
    """Do all jobs that are not finished; 0, or 1 when any failed.

    Raises:
        DuckpilotError: a job cannot be done at all; then none was begun.
    """
    waiting = []
    for job in jobs:
        if job.finished():
            console.print(f"{job.title}: finished before", markup=False)
        else:
            waiting.append(job)
    if not waiting:
        return 0
    workers = _workers(many)
    board = Board(waiting, console)
    outcomes: list[Outcome] = []
    try:
        left = {workers.submit(job, board.begin) for job in waiting}
        while left:
            done, left = futures.wait(left, PERIOD_S, futures.FIRST_COMPLETED)
            for each in done:
                outcomes.append(each.result())
                board.end(outcomes[-1])
            board.look()
    except KeyboardInterrupt:
        workers.stop()
        console.print("interrupted; the same command goes on")
        return INTERRUPTED
    finally:
        board.stop()
        workers.close()
    failures = [outcome for outcome in outcomes if outcome.status != 0]
    for outcome in failures:
        text = f"{outcome.job.title}: failed, {outcome.said} (see {outcome.job.log})"
        console.print(text, style="red", markup=False)
    console.print(f"{len(outcomes) - len(failures)} of {len(outcomes)} done")
    return 1 if failures else 0


class Board:
    """A line for each job that runs, and one for each that has ended."""

    def __init__(self, jobs: Sequence[Job], console: Console) -> None:
        self._bar = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            TextColumn("{task.fields[text]}"),
            TimeElapsedColumn(),
            console=console,
        )
        self._running: set[Job] = set()
        add = self._bar.add_task
        self._rows: dict[Job, TaskID] = {
            job: add(job.title, start=False, visible=False, text="") for job in jobs
        }
        self._bar.start()

    def begin(self, job: Job) -> None:
        """Show its line."""
        self._running.add(job)
        self._bar.start_task(self._rows[job])
        self._bar.update(self._rows[job], visible=True, total=None)

    def look(self) -> None:
        """Read how the jobs that run are doing."""
        for job in list(self._running):
            done, total, text = job.progress()
            if total:
                text = f"{done:,.0f}/{total:,.0f} · {text}"
                self._bar.update(self._rows[job], completed=done, total=total, text=text)

    def end(self, outcome: Outcome) -> None:
        """Its line gives way to what it said last."""
        self._running.discard(outcome.job)
        self._bar.update(self._rows[outcome.job], visible=False)
        if outcome.status == 0:
            self._bar.console.print(outcome.said, markup=False)

    def stop(self) -> None:
        """Give the terminal back."""
        self._bar.stop()


def _workers(many: WorkerOptions) -> Workers:
    if many.ray is not None:
        return RayWorkers(many.ray)
    count = len(os.sched_getaffinity(0)) if many.workers is None else many.workers
    if count < 1:
        raise ConfigError(f"workers: expected 1 or more, got {count}")
    return LocalWorkers(count)


def _choices(options: Any, many: SweepOptions, seed_step: int) -> dict[str, list[Any]]:
    """For each option that varies the values that it has, in the order of the file."""
    choices: dict[str, list[Any]] = {}
    given = {} if many.matrix is None else read_yaml(many.matrix)
    if not isinstance(given, dict):
        raise ConfigError(
            f"{many.matrix}: expected options with lists of values, got {type(given).__name__}"
        )
    for key, values in given.items():
        if not isinstance(values, list) or not values:
            raise ConfigError(f"{many.matrix}: {key}: expected a list of values, got {values!r}")
        name = str(key).replace("-", "_")
        several = isinstance(getattr(options, name, None), tuple)
        choices[name] = [[v] if several and isinstance(v, str) else v for v in values]
    if many.seeds is not None:
        if many.seeds < 1 or "seed" in choices:
            raise ConfigError(
                f"seeds: expected 1 or more, and no seed in the matrix, got {many.seeds}"
            )
        choices["seed"] = [options.seed + k * seed_step for k in range(many.seeds)]
    return choices


def _slug(value: Any) -> str:
    if isinstance(value, list):
        return "+".join(map(_slug, value))
    return re.sub(r"[^A-Za-z0-9.]+", "-", str(value)).strip("-")
