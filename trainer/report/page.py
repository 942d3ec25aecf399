"""The report: runs and their evaluations in PNG pictures and one HTML page that holds them all."""

import base64
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from jinja2 import Environment, PackageLoader, StrictUndefined

from robot.errors import ConfigError, expect_one_of
from robot.output import write_text
from robot.typed_config import from_plain, read_json, read_yaml
from sim_pybullet.tasks.spec import TASKS, PaperRow, TaskSpec, find_task, learned_tasks
from trainer.algorithms import NAMES, find_algorithm
from trainer.config import RunConfig
from trainer.judging.evaluate import FILM_S, Evaluation
from trainer.judging.films import films, films_of
from trainer.options import EvaluateOptions
from trainer.report.curves import SKILLED, draw_panels
from trainer.run import Episode, RunFolder
from trainer.training.checkpoint import Evaluated, TrainState, read_state

_NAMED_MAPS = 2  # at most, where there is little room


@dataclass(frozen=True, eq=False)
class Judgement:
    """One evaluation of a run's exported policy."""

    path: Path
    result: Evaluation
    where: str  # on which maps, in which looks, with which pose error
    paper: PaperRow  # under conditions like these


@dataclass(frozen=True, eq=False)
class Run:
    """One training."""

    folder: RunFolder
    config: RunConfig
    state: TrainState
    episodes: tuple[Episode, ...]
    judgements: tuple[Judgement, ...]

    @property
    def name(self) -> str:
        """Algorithm, preset, seed, and what of maps, look and pose error is not the default."""
        config = self.config
        parts = [find_algorithm(config.algorithm).title, config.preset]
        maps = [Path(name).stem for name in config.maps]
        parts.append(" + ".join(maps) if len(maps) <= _NAMED_MAPS else f"{len(maps)} maps")
        if config.look != "nominal":
            parts.append(Path(config.look).stem)
        if config.pose_error is not None:
            parts.append(f"pose error {config.pose_error}")
        return " · ".join([*parts, f"seed {config.seed}"])

    @property
    def paper(self) -> PaperRow:
        """What paper A says of it."""
        return find_task(self.config.task).paper.get(self.config.algorithm, PaperRow())

    @property
    def steps(self) -> int:
        """Of the training so far."""
        ended = [e.step for e in self.episodes[-1:]]
        return max([0, *ended, *(e.step for e in self.state.evaluations)])

    @property
    def skilled(self) -> Evaluated | None:
        """The first evaluation during training with at least `SKILLED` success."""
        return next((e for e in self.state.evaluations if e.success_rate >= SKILLED), None)

    @property
    def first(self) -> Judgement | None:
        """Its first evaluation with all that a policy sees."""
        return next((each for each in self.judgements if not each.result.inputs.zero), None)


def find_runs(paths: Iterable[Path]) -> list[Path]:
    """Run folders: the paths, or all that lie below them; ConfigError where there is none."""
    found: list[Path] = []
    for path in paths:
        every = path.rglob("config.yaml")
        below = sorted(file.parent for file in every if file.parent == path or _of_policy(file))
        if not below:
            raise ConfigError(f"{path}: expected the folder of a run, or of runs: no config.yaml")
        found += [path] if path in below else below
    return list(dict.fromkeys(found))


def _of_policy(config: Path) -> bool:
    """Whether it is a policy's, or nobody's; translators and parsers have no algorithm."""
    plain = read_yaml(config)
    return not (isinstance(plain, dict) and plain) or "algorithm" in plain


def read_runs(paths: Iterable[Path], problems: list[str]) -> list[Run]:
    """The runs of `find_runs` by task, algorithm and seed; ConfigError for one that is damaged.

    What of their evaluations cannot be read is told in ``problems``.
    """
    tasks, runs = list(TASKS), []
    for path in find_runs(paths):
        folder = RunFolder(path)
        config = folder.load_config()
        state = read_state(folder.checkpoint) if folder.checkpoint.exists() else TrainState()
        found = (_judgement(file, config, problems) for file in sorted(path.glob("*.json")))
        judgements = tuple(each for each in found if each is not None)
        place = tasks.index(config.task), NAMES.index(config.algorithm), config.seed
        runs.append((place, Run(folder, config, state, tuple(folder.episodes()), judgements)))
    return [run for _, run in sorted(runs, key=lambda each: each[0])]


def _judgement(file: Path, config: RunConfig, problems: list[str]) -> Judgement | None:
    """None where the file holds something else than an evaluation."""
    try:
        data = read_json(file)
        if not isinstance(data.get("inputs"), dict) or "success_rate" not in data:
            return None
        inputs = {k: v for k, v in data["inputs"].items() if k != "maps"}
        inputs["map"] = data["inputs"].get("maps", [])
        result = from_plain(Evaluation, {**data, "inputs": inputs}, where=str(file))
        asked = result.inputs
        expect_one_of(f"{file}: task", asked.task, TASKS)
    except ConfigError as error:
        problems.append(str(error))
        return None
    # Ours under their conditions: nothing of the paper's is like an input zeroed.
    like = asked.zero is None and asked.task == config.task
    papers = find_task(asked.task).paper if like else {}
    return Judgement(
        file, result, _where(asked, config.task), papers.get(config.algorithm, PaperRow())
    )


def _where(asked: EvaluateOptions, learned: str) -> str:
    maps = ", ".join(Path(name).stem for name in asked.map)
    parts = [maps if asked.task == learned else f"{asked.task} on {maps}", Path(asked.look).stem]
    if find_task(asked.task).path_points:
        true = asked.pose_error == "none" or (asked.pose_error is None and asked.look == "nominal")
        parts.append("true pose" if true else f"pose error {asked.pose_error or 'of the look'}")
    if asked.zero:
        parts.append(f"{asked.zero} zeroed")
    if asked.translate:
        parts.append(f"through {Path(asked.translate).stem}")
    if (model := Path(asked.model).name) != "model.onnx":
        parts.append(model)
    return " · ".join(parts)


PAGE = "report.html"
FILM_BYTES = 16_000_000  # a longer one is named, not put into the page


class Picture(NamedTuple):
    """A PNG or an MP4 that is put into the page."""

    title: str
    path: Path
    caption: str = ""

    @property
    def data(self) -> str:
        """Base64."""
        return base64.b64encode(self.path.read_bytes()).decode("ascii")


def write_report(paths: Sequence[Path], out: Path) -> Path:
    """Write the report of all runs at or below ``paths`` into the folder ``out``; the page.

    ConfigError if there are no runs, or one is damaged.
    """
    missing: list[str] = []
    runs = read_runs(paths, missing)
    out.mkdir(parents=True, exist_ok=True)
    tasks = [
        (task, some)
        for task in learned_tasks()
        if (some := [run for run in runs if run.config.task == task.name])
    ]
    drawn = [(task, some) for task, some in tasks if any(run.episodes for run in some)]
    pictures = {"films": _films(paths, runs, missing), "worst": _worst(runs)}
    pictures["curves"] = [_curves(task, some, out) for task, some in drawn]
    told = {"runs": runs, "tasks": tasks, "pictures": pictures, "missing": missing}
    write_page("page.html", out / PAGE, **told, film_s=FILM_S)
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
    names = {run.folder.film: run.folder.path.resolve().name for run in runs}
    shown, worst = [], {picture.path for picture in _worst(runs)}
    for folder in dict.fromkeys([*paths, *(run.folder.path for run in runs)]):
        for file in sorted({*folder.glob("[!.]*.mp4")} - worst):
            if file.stat().st_size > FILM_BYTES:
                missing.append(f"{file}: too large for this page; open it beside it")
                continue
            title, caption = file.stem.capitalize(), ""
            if file in names:
                title, caption = f"The latest evaluation of {names[file]}", "What one robot saw."
            shown.append(Picture(title, file, caption))
    return shown


def _curves(task: TaskSpec, runs: Sequence[Run], out: Path) -> Picture:
    """A row of panels for each run that has an episode, the paper's algorithms first."""
    shown = sorted(runs, key=lambda run: [*task.paper, *NAMES].index(run.config.algorithm))
    path = out / f"curves_{task.name}.png"
    records = [(run.name, [(run.episodes, run.state.evaluations)]) for run in shown if run.episodes]
    draw_panels(records, path)
    return Picture(task.title, path)


def _worst(runs: Sequence[Run]) -> list[Picture]:
    """Films of episodes that failed or left their lane."""
    pictures: list[Picture] = []
    for run in runs:
        for each in run.judgements:
            told = f"{run.name}, {each.where}."
            pictures += [Picture(name, path, told) for name, path in films(*films_of(each.path))]
    return pictures
