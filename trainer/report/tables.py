"""The figures of runs, ready to be put into tables beside the paper's."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from sim_pybullet.tasks.spec import PaperRow, find_task
from trainer.algorithms import find_algorithm
from trainer.judging.evaluate import wilson_low
from trainer.options import EvaluateOptions
from trainer.report.runs import Judgement, Run

NONE = "–"
_NAMED_MAPS = 2  # at most, where there is little room


class LearningRow(NamedTuple):
    """How fast a run learned."""

    name: str
    paper: PaperRow
    steps: str  # until it drove well
    seconds: str
    cpu_seconds: str
    used: str  # steps of the whole training
    best: str  # success of the kept policy, in the evaluation during training


class Card(NamedTuple):
    """What a run has come to, in one figure and a few words."""

    name: str
    figure: str
    meaning: str
    facts: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class DrivingRow:
    """How the exported policy of a run drove in one evaluation."""

    run: Run
    judgement: Judgement
    name: str  # what drove
    where: str  # on which maps, in which looks, with which pose error
    paper: PaperRow
    share: str
    success: str  # the share with the lower end of its 95 % interval
    distance: str  # mean distance from the path, over all decisions
    olympics: tuple[str, ...]  # in the lane, survival, deviation over time, outside; per episode


def describe(run: Run) -> str:
    """Algorithm, preset, seed, and what of maps, look and pose error is not the default."""
    config = run.config
    parts = [find_algorithm(config.algorithm).title, config.preset]
    maps = [Path(name).stem for name in config.maps]
    parts.append(" + ".join(maps) if len(maps) <= _NAMED_MAPS else f"{len(maps)} maps")
    if config.look != "nominal":
        parts.append(Path(config.look).stem)
    if config.pose_error is not None:
        parts.append(f"pose error {config.pose_error}")
    return " · ".join([*parts, f"seed {config.seed}"])


def learning_row(run: Run) -> LearningRow:
    """The run's row."""
    skilled, best = run.skilled, run.state.best
    return LearningRow(
        describe(run),
        find_task(run.config.task).paper.get(run.config.algorithm, PaperRow()),
        _told(skilled.step if skilled else None),
        _told(skilled.seconds if skilled else None),
        _told(skilled.cpu_seconds if skilled else None),
        f"{run.steps:,}",
        f"{100 * best.success_rate:.0f} %" if best else NONE,
    )


def _told(value: float | None) -> str:
    return NONE if value is None or math.isnan(value) else f"{value:,.0f}"


def summary_card(run: Run, rows: Sequence[DrivingRow]) -> Card:
    """The run's card: its first evaluation, or what its training has reached."""
    row = learning_row(run)
    facts = [f"learned after {row.steps} steps, {row.seconds} s"] if row.steps != NONE else []
    facts.append(f"trained {row.used} steps")
    if not run.state.stopped_by:
        facts.append(f"not finished (of {run.config.steps:,} steps)")
    own = (one for one in rows if one.run is run and not one.judgement.result.inputs.zero)
    first = next(own, None)
    if first is None:
        meaning = "best evaluation during training" if row.best != NONE else "no evaluation yet"
        return Card(row.name, row.best, meaning, tuple(facts))
    facts.insert(0, f"{first.distance} from the path on average")
    episodes = first.judgement.result.episodes
    meaning = f"of {episodes} episodes driven to the end, {first.where}"
    return Card(row.name, first.share, meaning, tuple(facts))


def driving_row(run: Run, judgement: Judgement) -> DrivingRow:
    """The row of one of a run's evaluations."""
    found, config = judgement.result, run.config
    asked = found.inputs
    # Ours under their conditions: nothing of the paper's is like an input zeroed.
    like = asked.zero is None and asked.task == config.task
    papers = find_task(asked.task).paper if like else {}
    successes = found.episodes - len(found.failures)
    low = _percent(wilson_low(successes, found.episodes))
    share = _percent(successes / found.episodes)
    return DrivingRow(
        run,
        judgement,
        name=describe(run),
        where=_where(asked, config.task),
        paper=papers.get(config.algorithm, PaperRow()),
        share=share,
        success=f"{share} ({successes} of {found.episodes}; at least {low})",
        distance=f"{100 * found.mean_path_distance_m:.1f} cm",
        olympics=(
            f"{found.driven_lane_m:.1f} m",
            f"{found.survival_time_s:.1f} s",
            f"{found.mean_path_distance_m * found.survival_time_s:.2f} m·s",
            f"{found.outside_lane_s:.2f} s",
        ),
    )


def _where(asked: EvaluateOptions, learned: str) -> str:
    maps = ", ".join(Path(name).stem for name in asked.map)
    parts = [maps if asked.task == learned else f"{asked.task} on {maps}", Path(asked.look).stem]
    if find_task(asked.task).path_points:
        parts.append(_pose(asked))
    if asked.zero:
        parts.append(f"{asked.zero} zeroed")
    if asked.translate:
        parts.append(f"through {Path(asked.translate).stem}")
    if (model := Path(asked.model).name) != "model.onnx":
        parts.append(model)
    return " · ".join(parts)


def _pose(asked: EvaluateOptions) -> str:
    """How wrong the overhead poses were."""
    if asked.pose_error == "none" or (asked.pose_error is None and asked.look == "nominal"):
        return "true pose"
    return f"pose error {asked.pose_error or 'of the look'}"


def _percent(share: float) -> str:
    return f"{100 * share:.1f} %"
