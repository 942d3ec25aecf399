"""What the commands ``train`` and ``evaluate`` do, as things that another process can do, too."""

import itertools
import re
from dataclasses import dataclass, fields, replace
from hashlib import sha256
from pathlib import Path
from typing import Any, TypeVar

from rich.console import Console

from robot.command_line import INTERRUPTED
from robot.errors import ConfigError
from robot.output import expect_folder
from robot.typed_config import from_plain, read_json, read_yaml, to_plain
from trainer.algorithms import find_algorithm
from trainer.config import RunConfig
from trainer.options import EvaluateOptions, SweepOptions, TrainOptions, WorkerOptions
from trainer.processes import processes_of
from trainer.run import RunFolder, refuse_run

T = TypeVar("T")
ONE = WorkerOptions(1)  # process, for one of many jobs


@dataclass(frozen=True)
class TrainJob:
    """A training in a run folder."""

    out: Path
    options: TrainOptions
    resume: bool
    given: tuple[str, ...] = ()  # of the options, those that a person gave
    by: WorkerOptions = ONE  # who does it

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
        from trainer.envs import make_env
        from trainer.training.train import train

        folder, options = RunFolder(self.out), self.options
        launcher = processes_of(self.by.ray, gpus=self.by.gpus)
        if not self.resume:
            refuse_run(self.out)
        if folder.config.exists():
            found = folder.load_config()
            if {each.name for each in fields(options)} & set(self.given) - {"steps", "seconds"}:
                folder.refuse_another(replace(options.config(), workers=found.workers))
            if self.by.workers not in (None, found.workers):
                raise ConfigError(
                    f"{self.out}: expected --workers {found.workers}, as the run was begun with, "
                    f"got {self.by.workers}; leave it out, or choose another --out"
                )
            limits: dict[str, Any] = {"steps": options.steps, "seconds": options.seconds}
            config = replace(found, **{k: v for k, v in limits.items() if v is not None})
            if said := ended(folder, config):
                console.print(f"{self.out}: done before, {said}; nothing to do", markup=False)
                return 0
        else:
            config, workers = options.config(), self.by.workers
            if workers is None:
                shares = find_algorithm(config.algorithm).shares
                workers = shares.good_number(config.learn, launcher.cores) if shares else 1
            config = replace(config, workers=workers)
        expect_folder(self.out)
        metrics = train(config, folder, make_env, console, launcher=launcher)
        console.print(
            f"{self.out}: {metrics.train_steps} steps in {metrics.train_seconds:.1f} s, success "
            f"{metrics.success_rate:.0%}, stopped by {metrics.stopped_by}"
        )
        return INTERRUPTED if metrics.stopped_by == "interrupted" else 0


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
        told = f"{folder.metrics}: expected the figures of a training, got others; delete it, and "
        raise ConfigError(f"{told}the run goes on") from error


@dataclass(frozen=True)
class EvaluateJob:
    """An evaluation in one process, into a JSON file."""

    out: Path
    options: EvaluateOptions
    drives: bool  # filmed beside the JSON file

    @property
    def log(self) -> Path:
        """Beside the JSON file."""
        return self.out.with_suffix(".log")

    def finished(self) -> bool:
        """Whether the JSON file answers the same question, of the policy as it is now."""
        from trainer.judging.judge import answers

        self.options.check()
        model, out = Path(self.options.model), self.out
        if not (out.exists() and answers(out, self.options)):
            return False
        known = read_json(out).get("model_sha256")  # a copied file has another age, too
        return not (known and model.exists() and sha256(model.read_bytes()).hexdigest() != known)

    def run(self, console: Console) -> int:
        """Drive, and say how it went."""
        from trainer.judging.judge import judge

        return judge(self.out, self.options, self.drives, 1, console)


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
        raise ConfigError(f"{many.matrix}: expected options with lists, got {type(given).__name__}")
    for key, values in given.items():
        if not isinstance(values, list) or not values:
            raise ConfigError(f"{many.matrix}: {key}: expected a list of values, got {values!r}")
        name = str(key).replace("-", "_")
        several = isinstance(getattr(options, name, None), tuple)
        choices[name] = [[v] if several and isinstance(v, str) else v for v in values]
    if many.seeds is not None:
        if many.seeds < 1 or "seed" in choices:
            raise ConfigError(f"seeds: expected 1 or more, no seed in the matrix, got {many.seeds}")
        choices["seed"] = [options.seed + k * seed_step for k in range(many.seeds)]
    return choices


def _slug(value: Any) -> str:
    if isinstance(value, list):
        return "+".join(map(_slug, value))
    return re.sub(r"[^A-Za-z0-9.]+", "-", str(value)).strip("-")
