"""What the commands ``train`` and ``evaluate`` do, as things that another process can do, too."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from rich.console import Console
from rich.table import Table

from robot.command_line import INTERRUPTED
from robot.errors import ConfigError
from robot.inference.translator import TranslatingPolicy, open_translator
from robot.navigation.road_map import RoadMap
from robot.output import expect_folder, expect_writable
from robot.typed_config import to_plain
from sim_pybullet.tasks.spec import find_task
from trainer.config import RunConfig
from trainer.division import maps_named, part_of
from trainer.envs import find_looks, load_places
from trainer.judging.drive_log import DriveLog, drives_beside
from trainer.judging.evaluate import (
    Drive,
    DrivingPolicy,
    Evaluation,
    Inputs,
    evaluate,
    open_policy,
    summarise,
)
from trainer.judging.rows import Rows, rows_beside
from trainer.judging.told import Told
from trainer.options import EvaluateOptions, TrainOptions, extended, refuse_others
from trainer.run import RunFolder, read_json, write_json
from trainer.sweeps.sweep import SweepOptions, combinations
from trainer.sweeps.workers import Progressed


@dataclass(frozen=True)
class TrainJob:
    """A training in a run folder."""

    out: Path
    options: TrainOptions
    resume: bool
    given: tuple[str, ...] = ()  # of the options, those that a person gave

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

    def progress(self) -> Progressed:
        """By the episodes so far."""
        recent = RunFolder(self.out).recent_episodes()
        total = float(self._steps)
        if not recent:
            return Progressed(0.0, total, "")
        reward = sum(e.reward for e in recent) / len(recent)
        last = recent[-1]
        return Progressed(last.step, total, f"reward {reward:.1f} · {last.seconds:.0f} s")

    @cached_property
    def _steps(self) -> int:
        return self.options.config().steps  # reads the look's file: once, not at every look

    def run(self, console: Console) -> int:
        """Train, and say how it went; a run that has ended is left as it is."""
        folder, options = RunFolder(self.out), self.options
        if not self.resume:
            folder.refuse_run()
        if folder.config.exists():
            found = folder.load_config()
            refuse_others(self.out, found, options, self.given)
            config = extended(found, options.steps, options.seconds)
            if said := ended(folder, config):
                console.print(f"{self.out}: done before, {said}; nothing to do", markup=False)
                return 0
        else:
            config = options.config()
        expect_folder(self.out)
        from trainer.envs import make_env
        from trainer.training.train import train

        metrics = train(config, folder, make_env, console)
        console.print(
            f"{self.out}: {metrics.train_steps} steps in {metrics.train_seconds:.1f} s, success "
            f"{metrics.success_rate:.0%}, stopped by {metrics.stopped_by}"
        )
        return INTERRUPTED if metrics.stopped_by == "interrupted" else 0


def ended(folder: RunFolder, config: RunConfig) -> str:
    """How a run ended whose limits are these; empty while it has something left to do.

    Raises:
        ConfigError: its metrics.json is damaged.
    """
    if not folder.metrics.exists():
        return ""
    metrics = read_json(folder.metrics)
    try:
        by, steps = metrics["stopped_by"], metrics["train_steps"]
        more = by == "steps" and steps < config.steps
        if by == "seconds":
            more = config.seconds is None or metrics["train_seconds"] < config.seconds
        return "" if more else f"{steps} steps, stopped by {by}"
    except (KeyError, TypeError, ValueError) as error:
        raise ConfigError(
            f"{folder.metrics}: expected the figures of a training, got others; delete it, and "
            "the run goes on"
        ) from error


@dataclass(frozen=True)
class EvaluateJob:
    """An evaluation, into a JSON file where one is named."""

    json: Path | None
    options: EvaluateOptions
    drives: bool  # kept beside the JSON file

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
        self.options.check()
        if self.json is None or not self.json.exists():
            return False
        found = read_json(self.json).get("inputs")
        found = {"lane": None, **found} if isinstance(found, dict) else {}  # once no choice
        task = found.get("task")
        if not task or found != to_plain(inputs(self.options, task)):
            raise ConfigError(
                f"{self.json}: expected the evaluation asked for, got another one; "
                "choose another --json"
            )
        return True

    def progress(self) -> Progressed:
        """Nobody knows before it ends."""
        return Progressed(0.0, 0.0, "")

    def run(self, console: Console) -> int:
        """Drive, and say how it went."""
        options = self.options
        kept_drives = drives_beside(self.json) if self.drives and self.json else None
        expect_writable(self.json, kept_drives, inputs=[Path(options.model)])
        policy: DrivingPolicy = open_policy(Path(options.model), options.task)
        if options.translate is not None:
            translator = open_translator(options.translate, policy.contract.image)
            policy = TranslatingPolicy(policy, translator)
        asked = inputs(options, policy.contract.task)
        maps = load_places(asked.task, asked.maps)
        if self.drives and not all(isinstance(place, RoadMap) for place in maps):
            raise ConfigError(
                f"drives: expected a task on maps, got {asked.task}: no map to draw on"
            )
        looks = find_looks(asked.task, options.look, options.pose_error, options.without)
        wanted = range(options.seed, options.seed + options.episodes)
        log = DriveLog() if self.drives else None
        if self.json is not None:
            self.json.parent.mkdir(parents=True, exist_ok=True)
        rows = self._rows(asked)
        kept = {} if rows is None else rows.drives
        left = [seed for seed in wanted if seed not in kept]
        drives = [kept[seed] for seed in wanted if seed in kept]
        title = f"{asked.task} {Path(options.model).name}"
        try:
            with Told(console, title, len(wanted), len(drives)) as told:
                asked_for = (policy, asked.task, maps, looks, left, _hearers(told, rows))
                drives += evaluate(*asked_for, asked.zero, log, asked.lane)
        except KeyboardInterrupt:
            if rows is not None:
                rows.close(done=False)
            console.print(_cut_off(rows))
            return INTERRUPTED
        parts = {place.name: part_of(place) for place in maps if isinstance(place, RoadMap)}
        result = summarise(asked, policy, sorted(drives), parts)
        if self.json is not None:
            if log is not None:
                log.save(drives_beside(self.json))
            write_json(self.json, result)
        if rows is not None:
            rows.close(done=True)
        _tell(console, result)
        return 0

    def _rows(self, asked: Inputs) -> Rows | None:
        """The drives of an evaluation that was cut off; tracks are not kept by the drive."""
        if self.json is None or self.drives:
            return None
        files = [Path(f) for f in (self.options.model, self.options.translate) if f is not None]
        return Rows(rows_beside(self.json), asked, files)


def _hearers(told: Told, rows: Rows | None) -> Callable[[Drive], None]:
    def hear(drive: Drive) -> None:
        if rows is not None:
            rows.add(drive)
        told.add(drive.success)

    return hear


def _cut_off(rows: Rows | None) -> str:
    if rows is None:
        return "interrupted; without --json, or with --drives, nothing is kept"
    return (
        f"interrupted; {len(rows.drives)} drives are kept in {rows.path}, the same command goes on"
    )


def _tell(console: Console, result: Evaluation) -> None:
    asked = result.inputs
    console.print(
        f"{asked.model}: success {result.success_rate:.1%} of {result.episodes} (at least "
        f"{result.success_rate_low:.1%} with 95 % confidence), "
        f"{100 * result.mean_path_distance_m:.1f} cm from the path"
    )
    if len(result.by_map) > 1:
        columns = ("map", "lane", "kept for", "succeeded", "from the path")
        table = Table(*columns, title=f"look {asked.look}")
        for row in result.by_map:
            succeeded = f"{row.succeeded} of {row.episodes}"
            from_path = f"{100 * row.mean_path_distance_m:.1f} cm"
            table.add_row(row.map, row.lane or "-", row.part or "nothing", succeeded, from_path)
        console.print(table)
    if result.laps is not None:
        console.print(
            f"{result.laps:.2f} laps, {result.collisions} collisions, "
            f"{result.mean_speed_mps:.1f} m/s on average"
        )


def inputs(options: EvaluateOptions, trained_for: str) -> Inputs:
    """What an evaluation is asked for, defaults filled in; the policy's own task is the default."""
    task = options.task or trained_for
    return Inputs(
        options.model,
        task,
        maps_named(options.map) or (find_task(task).map,),
        options.look,
        options.pose_error,
        options.zero,
        options.episodes,
        options.seed,
        options.translate,
        options.without,
        options.lane,
    )


def train_jobs(out: Path, options: TrainOptions, many: SweepOptions) -> list[TrainJob]:
    """A training in a folder of ``out`` for each combination; ConfigError as of `combinations`."""
    found = combinations(options, many)
    return [TrainJob(out / name, each, resume=True) for name, each in found]


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
