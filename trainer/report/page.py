"""The report: PNG pictures and one HTML page that holds them all."""

from __future__ import annotations

import base64
import shlex
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from jinja2 import Environment, PackageLoader, StrictUndefined

from robot.errors import MapError
from robot.navigation.road_map import load_map
from robot.output import write_text
from sim_pybullet.tasks.spec import PaperRow, TaskSpec, learned_tasks
from trainer.algorithms import NAMES
from trainer.judging.drive_log import FILM_S, Track, film_of
from trainer.report.curves import draw_panels
from trainer.report.drives import draw_drives, tell
from trainer.report.runs import Judgement, Run, read_runs

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
UNTIL = ("up to its end.", "up to where it was farthest from its path.")  # a failure, or none


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
    out.mkdir(parents=True, exist_ok=True)
    films = _films(paths, runs, missing)
    curves = [picture for task in learned_tasks() if (picture := _curves(task, runs, out))]
    drives, worst = _drives(runs, out, missing), _worst(runs)
    write_page(
        "page.html",
        out / PAGE,
        runs=runs,
        tasks=[table for task in learned_tasks() if (table := _table(task, runs))],
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


def _table(task: TaskSpec, runs: Sequence[Run]) -> tuple | None:
    """Title, runs, and whether the paper has figures for any."""
    learning = [run for run in runs if run.config.task == task.name]
    papers = [run.paper for run in learning]
    papers += [each.paper for run in learning for each in run.judgements]
    theirs = any(paper != PaperRow() for paper in papers)
    return (task.title, learning, theirs) if learning else None


def _films(paths: Sequence[Path], runs: Sequence[Run], missing: list[str]) -> list[Picture]:
    """Every MP4 in a run's folder, or in a folder that was named."""
    latest = {run.folder.film: f"The latest evaluation of {run.folder.name}" for run in runs}
    films, worst = [], {picture.path for picture in _worst(runs)}
    for folder in dict.fromkeys([*paths, *(run.folder.path for run in runs)]):
        for file in sorted({*folder.glob("[!.]*.mp4")} - worst):
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
    draw_panels([(r.name, [(r.episodes, r.state.evaluations)]) for r in shown], path)
    return Picture(task.title, CURVES, path)


def _driven(runs: Sequence[Run]) -> Iterator[tuple[Run, Judgement, list[Track]]]:
    """Evaluations that kept drives."""
    for run in runs:
        for each in run.judgements:
            if each.drives is not None:
                yield run, each, each.drives


def _drives(runs: Sequence[Run], out: Path, missing: list[str]) -> list[Picture]:
    pictures: list[Picture] = []
    for run, each, drives in _driven(runs):
        try:
            road_maps = [load_map(name) for name in each.result.inputs.map]
        except MapError as error:
            missing.append(f"drive map of {run.name}: {error}")
            continue
        path = out / f"drives_{len(pictures) + 1}.png"
        draw_drives(road_maps, drives, path)
        pictures.append(Picture(run.name, f"{each.where}. {DRIVES}", path))
    return pictures


def _worst(runs: Sequence[Run]) -> list[Picture]:
    """Films of episodes that failed or left their lane."""
    pictures: list[Picture] = []
    for run, each, drives in _driven(runs):
        for track in sorted(drives, key=lambda track: track.badness, reverse=True):
            film = film_of(each.path, track.seed)
            if film.exists():
                told = f"{run.name}, {each.where}. {FILM_S:.0f} s at most, {UNTIL[track.success]}"
                pictures.append(Picture(tell(track, each.result.inputs.map), told, film))
    return pictures


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
        f"{each.path}: no drives kept, so no map and no films; evaluate again with --drives"
        for each in run.judgements
        if each.drives is None
    ]
