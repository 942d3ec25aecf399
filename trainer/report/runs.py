"""Runs and evaluations, read from run folders."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from robot.errors import ConfigError
from robot.typed_config import from_plain
from sim_pybullet.tasks.spec import TASKS
from trainer.algorithms import NAMES
from trainer.config import RunConfig
from trainer.judging.drive_log import DriveLog, drives_beside, load_drives
from trainer.judging.evaluate import Evaluation
from trainer.report.curves import SKILLED
from trainer.run import Episode, RunFolder, read_json
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


def find_runs(paths: Iterable[Path]) -> list[Path]:
    """Run folders: the paths, or all that lie below them; ConfigError where there is none."""
    found: list[Path] = []
    for path in paths:
        below = sorted(file.parent for file in path.rglob("config.yaml"))
        if not below:
            raise ConfigError(f"{path}: expected the folder of a run, or of runs: no config.yaml")
        found += [path] if path in below else below
    return list(dict.fromkeys(found))


def read_runs(paths: Iterable[Path], problems: list[str]) -> list[Run]:
    """The runs of `find_runs` by task, algorithm and seed; ConfigError for one that is damaged.

    What of their evaluations cannot be read is told in ``problems``.
    """
    tasks, runs = list(TASKS), []
    for path in find_runs(paths):
        folder = RunFolder(path)
        state = read_state(folder.checkpoint) if folder.checkpoint.exists() else TrainState()
        found = (_judgement(file, problems) for file in sorted(path.glob("*.json")))
        judgements = tuple(each for each in found if each is not None)
        config, episodes = folder.load_config(), tuple(folder.episodes())
        runs.append(Run(folder, config, state, episodes, judgements))

    def order(run: Run) -> tuple[int, int, int]:
        config = run.config
        return tasks.index(config.task), NAMES.index(config.algorithm), config.seed

    return sorted(runs, key=order)


def _judgement(file: Path, problems: list[str]) -> Judgement | None:
    """None where the file holds something else than an evaluation."""
    try:
        data = read_json(file)
        if "inputs" not in data or "success_rate" not in data:
            return None
        inputs = {k: v for k, v in data["inputs"].items() if k != "maps"}
        inputs["map"] = data["inputs"].get("maps", [])
        result = from_plain(Evaluation, {**data, "inputs": inputs}, where=str(file))
    except ConfigError as error:
        problems.append(str(error))
        return None
    drives = drives_beside(file)
    try:
        return Judgement(file, result, load_drives(drives) if drives.exists() else None)
    except ConfigError as error:
        problems.append(str(error))
        return Judgement(file, result, None)
