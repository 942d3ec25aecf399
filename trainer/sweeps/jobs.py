"""What the commands ``train`` and ``evaluate`` do, as things that another process can do, too."""

from __future__ import annotations

import itertools
import re
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from rich.console import Console

from robot.command_line import INTERRUPTED
from robot.errors import ConfigError
from robot.output import expect_folder
from robot.typed_config import from_plain, read_json, read_yaml, to_plain
from trainer.config import RunConfig
from trainer.options import EvaluateOptions, TrainOptions, extended
from trainer.run import RunFolder, refuse_run
from trainer.sweeps.sweep import SweepOptions, WorkerOptions

T = TypeVar("T")

if TYPE_CHECKING:
    from trainer.processes import Processes


@dataclass(frozen=True)
class TrainJob:
    """A training in a run folder."""

    out: Path
    options: TrainOptions
    resume: bool
    given: tuple[str, ...] = ()  # of the options, those that a person gave
    alone: WorkerOptions | None = None  # who does it; one process, where it is one of many

    @property
    def title(self) -> str:
        """Its folder."""
        return str(self.out)

    @property
    def log(self) -> Path:
        """In the run folder."""
        return self.out / "log.txt"

    def finished(self) -> bool:
        """Whether the run has used its steps or seconds, or has learned its task."""
        folder, config = RunFolder(self.out), self.options.config()
        folder.refuse_another(config)
        return bool(ended(folder, config))

    def run(self, console: Console) -> int:
        """Train, and say how it went; a run that has ended is left as it is."""
        folder, options, launcher = RunFolder(self.out), self.options, self._launcher()
        if not self.resume:
            refuse_run(self.out)
        if folder.config.exists():
            found = folder.load_config()
            if {each.name for each in fields(options)} & set(self.given) - {"steps", "seconds"}:
                folder.refuse_another(replace(options.config(), workers=found.workers))
            if self.alone and self.alone.workers not in (None, found.workers):
                raise ConfigError(
                    f"{self.out}: expected --workers {found.workers}, as the run was begun with, "
                    f"got {self.alone.workers}; leave it out, or choose another --out"
                )
            config = extended(found, options.steps, options.seconds)
            if said := ended(folder, config):
                console.print(f"{self.out}: done before, {said}; nothing to do", markup=False)
                return 0
        else:
            config = options.config()
            config = replace(config, workers=self._processes(config, launcher))
        expect_folder(self.out)
        from trainer.envs import make_env
        from trainer.training.train import train

        metrics = train(config, folder, make_env, console, launcher=launcher)
        console.print(
            f"{self.out}: {metrics.train_steps} steps in {metrics.train_seconds:.1f} s, success "
            f"{metrics.success_rate:.0%}, stopped by {metrics.stopped_by}"
        )
        return INTERRUPTED if metrics.stopped_by == "interrupted" else 0

    def _launcher(self) -> Processes:
        """Who starts the other processes of the training."""
        from trainer.processes import LocalProcesses, RayProcesses

        ray = None if self.alone is None else self.alone.ray
        return LocalProcesses() if ray is None else RayProcesses(ray)

    def _processes(self, config: RunConfig, launcher: Processes) -> int:
        """As many as are asked for, else as serve; one, where this is one of many jobs."""
        from trainer.algorithms import find_algorithm
        from trainer.training.crew import good_number

        if self.alone is not None and self.alone.workers is not None:
            return self.alone.workers
        if self.alone is None or find_algorithm(config.algorithm).own_workers:
            return 1
        return good_number(config.learn.robots, launcher.cores)


def ended(folder: RunFolder, config: RunConfig) -> str:
    """How a run ended whose limits are these; empty while it has something left to do.

    ConfigError if its metrics.json is damaged.
    """
    if not folder.metrics.exists():
        return ""
    metrics = read_json(folder.metrics)
    try:
        by, steps, seconds = (metrics[k] for k in ("stopped_by", "train_steps", "train_seconds"))
        more = by == "steps" and steps < config.steps
        more |= by == "seconds" and (config.seconds is None or seconds < config.seconds)
        return "" if more else f"{steps} steps, stopped by {by}"
    except (KeyError, TypeError) as error:
        raise ConfigError(
            f"{folder.metrics}: expected the figures of a training, got others; delete it, and "
            "the run goes on"
        ) from error


@dataclass(frozen=True)
class EvaluateJob:
    """An evaluation, into a JSON file where one is named."""

    json: Path | None
    options: EvaluateOptions
    drives: bool  # filmed beside the JSON file
    alone: WorkerOptions | None = None  # who does it; one process, where it is one of many

    @property
    def title(self) -> str:
        """What it writes."""
        return str(self.json or self.options.model)

    @property
    def log(self) -> Path:
        """Beside the JSON file."""
        return (self.json or Path("evaluation.json")).with_suffix(".log")

    def finished(self) -> bool:
        """Whether the JSON file answers the same question."""
        from trainer.judging.judge import answers

        self.options.check()
        return self.json is not None and self.json.exists() and answers(self.json, self.options)

    def run(self, console: Console) -> int:
        """Drive, and say how it went."""
        from trainer.judging.judge import judge

        workers = 1 if self.alone is None else self.alone.workers
        return judge(self.json, self.options, self.drives, workers, console)


def evaluate_jobs(
    file: Path | None, options: EvaluateOptions, drives: bool, many: SweepOptions
) -> list[EvaluateJob]:
    """An evaluation for each combination, on episodes of its own for each of ``--seeds``.

    Each goes to ``file`` with what is its own added to the name, or without ``file`` to
    ``evaluation_….json`` beside its model. ConfigError as of `combinations`.
    """
    jobs = []
    for name, each in combinations(options, many, seed_step=options.episodes):
        beside = file or Path(each.model).parent / "evaluation.json"
        path = beside.with_name("_".join(filter(None, (beside.stem, name))) + beside.suffix)
        jobs.append(EvaluateJob(path, each, drives))
    return jobs


def combinations(options: T, many: SweepOptions, seed_step: int = 1) -> list[tuple[str, T]]:
    """Every combination of what is to vary: a name that tells what is its own, and its options.

    ``options`` is a frozen dataclass; ``seed_step`` from one of ``--seeds`` to the next.
    ConfigError for an unknown option, a value of the wrong kind, or two equal combinations.
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
