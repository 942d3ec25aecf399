"""Runs and evaluations, read from run folders; what differs in the seed alone belongs together."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from robot.errors import ConfigError
from robot.typed_config import from_plain
from sim_pybullet.tasks.spec import TASKS
from trainer.algorithms import algorithm_names
from trainer.config import RunConfig
from trainer.judging.drive_log import DriveLog, drives_beside, load_drives
from trainer.judging.evaluate import Evaluation
from trainer.report.curves import SKILLED
from trainer.run import Episode, RunFolder
from trainer.training.checkpoint import Evaluated, TrainState, read_state


@dataclass(frozen=True, eq=False)
class Judgement:
    """One evaluation of a run's exported policy."""

    path: Path
    result: Evaluation
    drives: DriveLog | None


@dataclass(frozen=True, eq=False)
class Run:
    """One training."""

    folder: RunFolder
    config: RunConfig
    state: TrainState
    episodes: tuple[Episode, ...]
    judgements: tuple[Judgement, ...]

    @property
    def steps(self) -> int:
        """Of the training so far."""
        ended = [e.step for e in self.episodes[-1:]]
        return max([0, *ended, *(e.step for e in self.state.evaluations)])

    @property
    def skilled(self) -> Evaluated | None:
        """The first evaluation during training with at least `SKILLED` success."""
        return next((e for e in self.state.evaluations if e.success_rate >= SKILLED), None)


@dataclass(frozen=True, eq=False)
class Group:
    """Runs that differ in nothing but the seed."""

    runs: tuple[Run, ...]

    @property
    def config(self) -> RunConfig:
        """Of the first one."""
        return self.runs[0].config

    @property
    def seeds(self) -> list[int]:
        """Of the runs."""
        return [run.config.seed for run in self.runs]


def find_runs(paths: Iterable[Path]) -> list[Path]:
    """Run folders: the paths themselves, or all that lie anywhere below them.

    Raises:
        ConfigError: there is none at or below a path.
    """
    found: list[Path] = []
    for path in paths:
        below = sorted(file.parent for file in path.rglob("config.yaml"))
        if not below:
            raise ConfigError(
                f"{path}: expected the folder of a run, or a folder of such folders, found no "
                "config.yaml"
            )
        found += [path] if path in below else below
    return list(dict.fromkeys(found))


def read_run(path: Path, problems: list[str]) -> Run:
    """One run; what of its evaluations cannot be read is told in ``problems``.

    Raises:
        ConfigError: the run's own configuration cannot be read.
    """
    folder = RunFolder(path)
    state = read_state(folder.checkpoint) if folder.checkpoint.exists() else TrainState()
    judgements = [_judgement(file, problems) for file in sorted(path.glob("*.json"))]
    episodes = tuple(folder.episodes())
    return Run(folder, folder.load_config(), state, episodes, tuple(filter(None, judgements)))


def group_runs(runs: Sequence[Run]) -> list[Group]:
    """By task, then by algorithm."""
    groups: dict[str, list[Run]] = {}
    for run in runs:
        groups.setdefault(repr(replace(run.config, seed=0, seconds=None)), []).append(run)
    tasks, algorithms = list(TASKS), algorithm_names()

    def order(group: Group) -> tuple[int, int]:
        return tasks.index(group.config.task), algorithms.index(group.config.algorithm)

    return sorted((Group(tuple(sorted(g, key=_seed))) for g in groups.values()), key=order)


def _seed(run: Run) -> int:
    return run.config.seed


def _judgement(file: Path, problems: list[str]) -> Judgement | None:
    """None where the file holds something else than an evaluation."""
    try:
        data = json.loads(file.read_text(encoding="utf-8"))
    except ValueError as error:
        problems.append(f"{file}: expected JSON, got: {error}")
        return None
    if not isinstance(data, dict) or "inputs" not in data or "success_rate" not in data:
        return None
    try:
        result = from_plain(Evaluation, data, where=str(file))
    except ConfigError as error:
        problems.append(str(error))
        return None
    return Judgement(file, result, _drives(drives_beside(file), problems))


def _drives(file: Path, problems: list[str]) -> DriveLog | None:
    try:
        return load_drives(file) if file.exists() else None
    except ConfigError as error:
        problems.append(str(error))
        return None
