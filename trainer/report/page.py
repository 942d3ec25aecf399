"""The report: PNG pictures and one HTML page that holds them all."""

from __future__ import annotations

import base64
import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from jinja2 import Environment, PackageLoader, StrictUndefined

from robot.errors import MapError
from robot.navigation.road_map import load_map
from sim_pybullet.tasks.spec import TaskSpec, learned_tasks
from trainer.algorithms import algorithm_names, find_algorithm
from trainer.judging.drive_log import WORST
from trainer.report.curves import draw_curve, draw_panels
from trainer.report.drives import draw_drives, draw_strips, strip_seconds
from trainer.report.runs import Group, Run, find_runs, group_runs, read_run
from trainer.report.tables import DrivingRow, describe, driving_rows, learning_row
from trainer.run import atomically

PAGE = "report.html"


class Picture(NamedTuple):
    """A PNG beside the page, and in it."""

    title: str
    caption: str
    path: Path

    @property
    def data(self) -> str:
        """Base64."""
        return base64.b64encode(self.path.read_bytes()).decode("ascii")


@dataclass(frozen=True)
class Pictures:
    """All of a report."""

    curves: tuple[Picture, ...]
    drives: tuple[Picture, ...]
    worst: tuple[Picture, ...]


def write_report(paths: Sequence[Path], out: Path) -> Path:
    """Write the report of all runs at or below ``paths`` into the folder ``out``; the page.

    Raises:
        ConfigError: there are no runs, or a run's configuration cannot be read.
    """
    problems: list[str] = []
    runs = [read_run(path, problems) for path in find_runs(paths)]
    groups = group_runs(runs)
    rows = driving_rows(groups)
    out.mkdir(parents=True, exist_ok=True)
    for run in runs:
        if run.episodes:
            draw_curve(run.folder, run.config)
    pictures = Pictures(
        tuple(_curves(task, groups, out) for task in learned_tasks() if _of(task, groups)),
        tuple(_drives(rows, out, problems)),
        tuple(_worst(rows, out)),
    )
    html = _render(runs, groups, rows, pictures, problems + _missing(groups))
    with atomically(out / PAGE) as temporary:
        temporary.write_text(html, encoding="utf-8")
    return out / PAGE


def _render(
    runs: Sequence[Run],
    groups: Sequence[Group],
    rows: Sequence[DrivingRow],
    pictures: Pictures,
    missing: Sequence[str],
) -> str:
    templates = Environment(
        loader=PackageLoader("trainer.report", "."), autoescape=True, undefined=StrictUndefined
    )
    return templates.get_template("page.html").render(
        runs=runs,
        tasks=[
            (
                task.title,
                [learning_row(group) for group in _of(task, groups)],
                [row for row in rows if row.group.config.task == task.name],
            )
            for task in learned_tasks()
            if _of(task, groups)
        ],
        pictures=pictures,
        missing=missing,
    )


def _of(task: TaskSpec, groups: Sequence[Group]) -> list[Group]:
    return [group for group in groups if group.config.task == task.name]


def _curves(task: TaskSpec, groups: Sequence[Group], out: Path) -> Picture:
    """The paper's panels in the paper's order, empty where there is no run, then all others."""
    panels = []
    for algorithm in dict.fromkeys((*task.paper, *algorithm_names())):
        found = [g for g in _of(task, groups) if g.config.algorithm == algorithm]
        for group in found:
            records = [(run.episodes, run.state.evaluations) for run in group.runs]
            panels.append((describe(group), records))
        if not found and algorithm in task.paper:
            panels.append((find_algorithm(algorithm).title, []))
    path = out / f"curves_{task.name}.png"
    draw_panels(panels, path)
    caption = (
        "Reward of each training episode (pink) and its 50-episode mean (dark red), exploration "
        "included. With several seeds: thin lines are the seeds, the thick line their mean, the "
        "band reaches from the lowest to the highest, as far as all of them trained. Dots: greedy "
        "evaluations, filled where no episode failed."
    )
    return Picture(f"{task.title}: learning curves", caption, path)


def _drives(rows: Sequence[DrivingRow], out: Path, problems: list[str]) -> list[Picture]:
    pictures: list[Picture] = []
    for row in rows:
        if not row.tracks:
            continue
        try:
            road_maps = [load_map(name) for name in row.inputs.maps]
        except MapError as error:
            problems.append(f"drive map of {row.name}: {error}")
            continue
        path = out / f"drives_{len(pictures) + 1}.png"
        draw_drives(road_maps, row.tracks, path)
        caption = (
            f"{row.where}. Up to 150 episodes that were done and all that failed, from above; "
            "crosses: where a robot failed. Colour: distance from the path."
        )
        pictures.append(Picture(row.name, caption, path))
    return pictures


def _worst(rows: Sequence[DrivingRow], out: Path) -> list[Picture]:
    pictures: list[Picture] = []
    for row in rows:
        worst = row.worst[:WORST]
        if not worst or row.inputs.zero:
            continue
        path = out / f"worst_{len(pictures) + 1}.png"
        draw_strips(worst, row.inputs.maps, path)
        failed = sum(not track.success for track in worst)
        if not failed:
            what = f"No episode failed; these {len(worst)} strayed farthest from their path."
        else:
            what = f"{row.episodes - row.successes} of {row.episodes} episodes failed."
            what += f" Shown: {failed}" + (
                f", then the {len(worst) - failed} that strayed farthest."
                if failed < len(worst)
                else "."
            )
        seconds = f"The last {strip_seconds():.1f} s before the worst moment, left to right."
        pictures.append(Picture(row.name, f"{row.where}. {what} {seconds}", path))
    return pictures


def _missing(groups: Sequence[Group]) -> list[str]:
    """What would complete the report, each with the command for it."""
    said = []
    for run in (run for group in groups for run in group.runs):
        name, model = run.folder.path, run.folder.onnx
        if not run.episodes:
            said.append(f"{name}: no episode has ended yet; train longer")
        if not run.judgements:
            command = ["python", "-m", "trainer", "evaluate", "--model", str(model), "--json"]
            command += [str(name / "evaluation.json"), "--drives"]
            first = "" if model.exists() else "its training has not come to a model yet; then "
            said.append(f"{name}: not evaluated yet; {first}{shlex.join(command)}")
        for judgement in run.judgements:
            if judgement.drives is None:
                said.append(
                    f"{judgement.path}: no drives kept, so no map and no film strips; "
                    "evaluate again with --drives"
                )
    return said
