"""What ``evaluate`` does; one that was cut off goes on with the drives that it has kept.

They lie beside its JSON file as JSON lines: first what is asked and of which policy, then one line
for each drive. That file is deleted once the evaluation is written.
"""

from __future__ import annotations

import hashlib
import json
from contextlib import suppress
from pathlib import Path

from rich.console import Console
from rich.progress import MofNCompleteColumn, Progress
from rich.table import Table

from robot.command_line import INTERRUPTED
from robot.errors import ConfigError
from robot.inference.translator import TranslatingPolicy, open_translator
from robot.navigation.road_map import RoadMap
from robot.output import expect_writable, write_json, write_text
from robot.typed_config import read_json, to_plain
from robot.vision.sight import OnnxSight
from sim_pybullet.batch import DriveMetrics
from sim_pybullet.sensing.guidance_feed import PoseSources
from sim_pybullet.tasks.spec import find_task
from trainer.division import part_of
from trainer.judging.evaluate import (
    Drive,
    DrivingPolicy,
    Evaluation,
    evaluate,
    open_policy,
    summarise,
)
from trainer.judging.films import Worst, films_of
from trainer.options import EvaluateOptions

_COLUMNS = (*Progress.get_default_columns(), MofNCompleteColumn())
_FREE = ("episodes", "seed")  # which episodes are asked for: a drive is the same among others


def judge(out: Path | None, options: EvaluateOptions, films: bool, console: Console) -> int:
    """Drive, write the figures to ``out``, if any, and say how it went; the exit status.

    ``films``: whether to film the worst beside ``out``; then single drives are not kept.
    """
    expect_writable(out, inputs=[Path(options.model)])
    policy = _open(options)
    asked = options.filled_in(policy.contract.task)
    spec = find_task(asked.task)
    maps = [spec.load(name) for name in asked.map]
    roads = [place for place in maps if isinstance(place, RoadMap)]
    looks = spec.looks(options.look, options.pose_error, options.without)
    worst = Worst() if films else None
    sources = PoseSources(asked.overhead, OnnxSight(asked.sight) if asked.sight else None)
    kept = KeptDrives(None if films else out, asked)
    wanted = range(asked.seed, asked.seed + asked.episodes)
    left = [seed for seed in wanted if seed not in kept.drives]
    title = f"{asked.task} {Path(asked.model).name}"
    with Progress(*_COLUMNS, console=console) as bar:
        row = bar.add_task(title, total=len(wanted), completed=len(wanted) - len(left))

        def hear(drive: Drive) -> None:
            kept.add(drive)
            bar.advance(row)

        try:
            where = asked.task, maps, looks, left, hear
            evaluate(policy, *where, asked.zero, worst, asked.lane, sources)
        except KeyboardInterrupt:
            console.print(f"interrupted; {kept.told()}")
            return INTERRUPTED
    parts = {road_map.name: part_of(road_map) for road_map in roads}
    result = summarise(asked, policy, [kept.drives[seed] for seed in wanted], parts)
    if out is not None:
        write_json(out, {**to_plain(result), "inputs": asked.plain()})
    if worst is not None and out is not None:
        worst.write(*films_of(out))
    kept.forget()
    _tell(console, result)
    return 0


def _open(options: EvaluateOptions) -> DrivingPolicy:
    policy = open_policy(Path(options.model), options.task)
    if options.translate is None:
        return policy
    return TranslatingPolicy(policy, open_translator(options.translate, policy.contract.image))


def answers(file: Path, options: EvaluateOptions) -> bool:
    """True: the JSON file answers what is asked; ConfigError if it answers something else."""
    found = read_json(file).get("inputs")
    found = {"lane": None, **found} if isinstance(found, dict) else {}  # once no choice
    task = found.get("task")
    if not task or found != options.filled_in(task).plain():
        raise ConfigError(
            f"{file}: expected the evaluation asked for, got another one; choose another --json"
        )
    return True


class KeptDrives:
    """The drives of an evaluation so far; without its JSON file they are in memory only.

    ConfigError if what lies there is of something else.
    """

    def __init__(self, evaluation: Path | None, asked: EvaluateOptions) -> None:
        self.drives: dict[int, Drive] = {}
        self._path = None
        if evaluation is None:
            return
        files = [Path(file) for file in (asked.model, asked.translate, asked.sight) if file]
        prints = [hashlib.sha256(file.read_bytes()).hexdigest()[:16] for file in files]
        plain = {k: v for k, v in asked.plain().items() if k not in _FREE}
        head = json.dumps({"schema": 1, "inputs": plain, "files": prints})
        self._path = evaluation.with_name(f"{evaluation.stem}.rows.jsonl")
        lines = [head]
        if self._path.exists():
            lines = self._path.read_text(encoding="utf-8", errors="replace").splitlines()
        if lines[:1] != [head]:
            raise ConfigError(
                f"{self._path}: expected the drives of an evaluation that was cut off, of this "
                "policy and with these options, got others; delete the file, or choose another "
                "--json"
            )
        with suppress(ValueError):  # of the last line, cut off
            for row in map(json.loads, lines[1:]):
                drive = Drive(**{**row, "metrics": DriveMetrics(*row["metrics"])})
                self.drives[drive.seed] = drive
        write_text(self._path, "\n".join(lines[: 1 + len(self.drives)]) + "\n")

    def add(self, drive: Drive) -> None:
        """Keep one more, on disk at once."""
        self.drives[drive.seed] = drive
        if self._path is not None:
            with self._path.open("a", encoding="utf-8") as file:
                file.write(json.dumps(drive._asdict()) + "\n")

    def told(self) -> str:
        """What an interruption leaves."""
        if self._path is None:
            return "nothing is kept without --json, or with --drives"
        return f"{len(self.drives)} drives are kept in {self._path}, the same command goes on"

    def forget(self) -> None:
        """The evaluation is written."""
        if self._path is not None:
            self._path.unlink()


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
