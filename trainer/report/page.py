"""The report: PNG pictures and one HTML page that holds them all."""

from __future__ import annotations

import base64
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from jinja2 import Environment, PackageLoader, StrictUndefined

from robot.errors import MapError
from robot.navigation.road_map import load_map
from robot.output import write_text
from sim_pybullet.tasks.following import HALF_LANE_TILES
from sim_pybullet.tasks.spec import PaperRow, TaskSpec, learned_tasks
from trainer.algorithms import NAMES
from trainer.judging.drive_log import WORST, Track
from trainer.report.curves import draw_panels
from trainer.report.drives import STRIP_S, draw_drives, draw_strips
from trainer.report.runs import Run, read_runs
from trainer.report.tables import (
    DrivingRow,
    describe,
    driving_row,
    learning_row,
    summary_card,
)

PAGE = "report.html"
FILM_BYTES = 16_000_000  # a longer one is named, not put into the page
CURVES = (
    "Dots: evaluations of the policy of that moment, filled where no episode failed. Red: mean of "
    "the last 50 training episodes (pink), which may be shorter and act by chance at times."
)
DRIVES = (
    "Every episode from above; crosses: where a robot failed. Colour: distance from the path, the "
    "worst on top."
)


class Picture(NamedTuple):
    """A PNG or an MP4 that is put into the page."""

    title: str
    caption: str
    path: Path

    @property
    def data(self) -> str:
        """Base64."""
        return base64.b64encode(self.path.read_bytes()).decode("ascii")


def write_report(paths: Sequence[Path], out: Path, live: bool = False) -> Path:
    """Write the report of all runs at or below ``paths`` into the folder ``out``; the page.

    A ``live`` page looks for news of itself. ConfigError if there are no runs, or one is damaged.
    """
    missing: list[str] = []
    runs = read_runs(paths, missing)
    rows = [driving_row(run, judgement) for run in runs for judgement in run.judgements]
    out.mkdir(parents=True, exist_ok=True)
    films = _films(paths, runs, missing)
    curves = [picture for task in learned_tasks() if (picture := _curves(task, runs, out))]
    drives, worst = _drives(rows, out, missing), _worst(rows, out)
    write_page(
        "page.html",
        out / PAGE,
        runs=runs,
        cards=[summary_card(run, rows) for run in runs],
        tasks=[table for task in learned_tasks() if (table := _table(task, runs, rows))],
        pictures={"films": films, "curves": curves, "drives": drives, "worst": worst},
        missing=[*missing, *(line for run in runs for line in _missing(run))],
        live=live,
    )
    return out / PAGE


def write_page(template: str, path: Path, **what: Any) -> None:
    """Write a page from one of the templates here."""
    templates = Environment(
        loader=PackageLoader("trainer.report", "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    write_text(path, templates.get_template(template).render(**what))


def _table(task: TaskSpec, runs: Sequence[Run], rows: Sequence[DrivingRow]) -> tuple | None:
    """Title, rows of learning and driving, and whether the paper has figures for any."""
    learning = [learning_row(run) for run in runs if run.config.task == task.name]
    driving = [row for row in rows if row.run.config.task == task.name]
    papers = [row.paper for row in learning] + [row.paper for row in driving]
    theirs = any(paper != PaperRow() for paper in papers)
    return (task.title, learning, driving, theirs) if learning else None


def _films(paths: Sequence[Path], runs: Sequence[Run], missing: list[str]) -> list[Picture]:
    """Every MP4 in a run's folder, or in a folder that was named."""
    latest = {run.folder.film: f"The latest evaluation of {run.folder.name}" for run in runs}
    films = []
    for folder in dict.fromkeys([*paths, *(run.folder.path for run in runs)]):
        for file in sorted(folder.glob("[!.]*.mp4")):
            if file.stat().st_size > FILM_BYTES:
                missing.append(f"{file}: too large for this page; open it beside it")
                continue
            caption = "What one robot saw." if file in latest else ""
            films.append(Picture(latest.get(file, file.stem.capitalize()), caption, file))
    return films


def _curves(task: TaskSpec, runs: Sequence[Run], out: Path) -> Picture | None:
    """A row of panels for each run that has an episode, the paper's algorithms first."""
    order = [*task.paper, *NAMES]
    shown = [run for run in runs if run.config.task == task.name and run.episodes]
    shown.sort(key=lambda run: order.index(run.config.algorithm))
    if not shown:
        return None
    path = out / f"curves_{task.name}.png"
    draw_panels([(describe(r), [(r.episodes, r.state.evaluations)]) for r in shown], path)
    return Picture(task.title, CURVES, path)


def _drives(rows: Sequence[DrivingRow], out: Path, missing: list[str]) -> list[Picture]:
    pictures: list[Picture] = []
    for row in rows:
        if row.judgement.drives is None:
            continue
        try:
            road_maps = [load_map(name) for name in row.judgement.result.inputs.map]
        except MapError as error:
            missing.append(f"drive map of {row.name}: {error}")
            continue
        path = out / f"drives_{len(pictures) + 1}.png"
        draw_drives(road_maps, row.judgement.drives.tracks, path)
        pictures.append(Picture(row.name, f"{row.where}. {DRIVES}", path))
    return pictures


def _worst(rows: Sequence[DrivingRow], out: Path) -> list[Picture]:
    pictures: list[Picture] = []
    for row in rows:
        found, drives = row.judgement.result, row.judgement.drives
        tracks = drives.worst if drives else []
        worst = [track for track in tracks if _went_wrong(track, found.inputs.map)][:WORST]
        if not worst or found.inputs.zero:
            continue
        path = out / f"worst_{len(pictures) + 1}.png"
        draw_strips(worst, found.inputs.map, path)
        failed = len(found.failures)
        what = f"{failed} of {found.episodes} episodes failed"
        what += "; the others shown left their lane for a while." if failed < len(worst) else "."
        seconds = f"The last {STRIP_S:.1f} s before the worst moment, left to right."
        pictures.append(Picture(row.name, f"{row.where}. {what} {seconds}", path))
    return pictures


def _went_wrong(track: Track, maps: Sequence[str]) -> bool:
    """Whether it failed, or was once out of its lane."""
    try:
        tile_m = load_map(maps[track.map_index]).tile_size_m
    except MapError:  # its file is gone
        return True
    return not track.success or track.deviation_m > HALF_LANE_TILES * tile_m


def _missing(run: Run) -> list[str]:
    """What would complete the report, each with the command for it."""
    path, model = run.folder.path, run.folder.onnx
    said = [] if run.episodes else [f"{path}: no episode has ended yet; train longer"]
    if not run.judgements:
        command = ["python", "-m", "trainer", "evaluate", "--model", str(model), "--json"]
        command += [str(path / "evaluation.json"), "--drives"]
        first = "" if model.exists() else "finish its training, then "
        said.append(f"{path}: not evaluated yet: {first}{shlex.join(command)}")
    return said + [
        f"{each.path}: no drives kept, so no map and no film strips; evaluate again with --drives"
        for each in run.judgements
        if each.drives is None
    ]
