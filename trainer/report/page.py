"""The report: PNG pictures and one HTML page that holds them all."""

from __future__ import annotations

import base64
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from jinja2 import Environment, PackageLoader, StrictUndefined

from robot.output import write_text
from sim_pybullet.tasks.spec import TaskSpec, learned_tasks
from trainer.algorithms import NAMES
from trainer.judging.films import films, films_of
from trainer.judging.rides import FILM_S
from trainer.report.curves import draw_panels
from trainer.report.runs import Run, read_runs

PAGE = "report.html"
FILM_BYTES = 16_000_000  # a longer one is named, not put into the page
CURVES = (
    "Dots: evaluations of the policy of that moment, filled where no episode failed. Red: mean of "
    "the last 50 training episodes (pink), which may be shorter and act by chance at times."
)
FILMED = (
    f"{FILM_S:.0f} s at most, up to its end, or to where it was farthest off when it got there."
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
    out.mkdir(parents=True, exist_ok=True)
    tasks = [
        (task, some)
        for task in learned_tasks()
        if (some := [run for run in runs if run.config.task == task.name])
    ]
    pictures = {
        "films": _films(paths, runs, missing),
        "curves": [
            _curves(task, some, out) for task, some in tasks if any(r.episodes for r in some)
        ],
        "worst": _worst(runs),
    }
    missing += [line for run in runs for line in _missing(run)]
    write_page(
        "page.html",
        out / PAGE,
        runs=runs,
        tasks=tasks,
        pictures=pictures,
        missing=missing,
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


def _films(paths: Sequence[Path], runs: Sequence[Run], missing: list[str]) -> list[Picture]:
    """Every MP4 in a run's folder, or in a folder that was named."""
    latest = {run.folder.film: f"The latest evaluation of {run.folder.name}" for run in runs}
    shown, worst = [], {picture.path for picture in _worst(runs)}
    for folder in dict.fromkeys([*paths, *(run.folder.path for run in runs)]):
        for file in sorted({*folder.glob("[!.]*.mp4")} - worst):
            if file.stat().st_size > FILM_BYTES:
                missing.append(f"{file}: too large for this page; open it beside it")
                continue
            caption = "What one robot saw." if file in latest else ""
            shown.append(Picture(latest.get(file, file.stem.capitalize()), caption, file))
    return shown


def _curves(task: TaskSpec, runs: Sequence[Run], out: Path) -> Picture:
    """A row of panels for each run that has an episode, the paper's algorithms first."""
    order = [*task.paper, *NAMES]
    shown = sorted(runs, key=lambda run: order.index(run.config.algorithm))
    path = out / f"curves_{task.name}.png"
    records = [(run.name, [(run.episodes, run.state.evaluations)]) for run in shown if run.episodes]
    draw_panels(records, path)
    return Picture(task.title, CURVES, path)


def _worst(runs: Sequence[Run]) -> list[Picture]:
    """Films of episodes that failed or left their lane."""
    pictures: list[Picture] = []
    for run in runs:
        for each in run.judgements:
            told = f"{run.name}, {each.where}. {FILMED}"
            pictures += [Picture(name, told, path) for name, path in films(*films_of(each.path))]
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
    return said
