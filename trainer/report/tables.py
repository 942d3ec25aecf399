"""The figures of groups of runs, ready to be put into tables beside the paper's."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median
from typing import NamedTuple

from sim_pybullet.tasks.spec import PaperRow, find_task
from trainer.algorithms import find_algorithm
from trainer.judging.drive_log import Track
from trainer.judging.evaluate import Inputs, wilson_low
from trainer.report.runs import Group, Judgement

NONE = "–"
_NAMED_MAPS = 2  # at most, where there is little room


class LearningRow(NamedTuple):
    """How fast a group learned."""

    name: str
    paper: PaperRow
    seeds: str
    learned: str  # how many runs came to drive well
    steps: str  # until then
    seconds: str
    cpu_seconds: str
    used: str  # steps of the whole training
    best: str  # success of the kept policies, in the evaluation during training


class Card(NamedTuple):
    """What a group has come to, in one figure and a few words."""

    name: str
    figure: str
    meaning: str
    facts: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class DrivingRow:
    """How the exported policies of a group drove under the same conditions."""

    group: Group
    inputs: Inputs  # of the first; the others differ in model and seeds
    name: str  # what drove
    where: str  # on which maps, in which looks, with which pose error
    paper: PaperRow
    episodes: int  # of all seeds together
    successes: int
    share: str
    success: str  # the share with the lower end of its 95 % interval
    by_run: str  # the success of each run
    distance: str  # mean distance from the path, over all decisions
    olympics: tuple[str, ...]  # in the lane, survival, deviation over time, outside; per episode
    tracks: tuple[Track, ...]  # of all seeds that kept theirs
    worst: tuple[Track, ...]  # those with film strips, the worst first


def describe(group: Group) -> str:
    """Algorithm, preset, and what of maps, look and pose error is not the default."""
    config = group[0].config
    parts = [find_algorithm(config.algorithm).title, config.preset]
    maps = [Path(name).stem for name in config.maps]
    parts.append(" + ".join(maps) if len(maps) <= _NAMED_MAPS else f"{len(maps)} maps")
    if config.look != "nominal":
        parts.append(Path(config.look).stem)
    if config.pose_error is not None:
        parts.append(f"pose error {config.pose_error}")
    return " · ".join(parts)


def learning_row(group: Group) -> LearningRow:
    """The group's row."""
    config = group[0].config
    skilled = [run.skilled for run in group if run.skilled is not None]
    best = [run.state.best.success_rate for run in group if run.state.best is not None]
    return LearningRow(
        name=describe(group),
        paper=find_task(config.task).paper.get(config.algorithm, PaperRow()),
        seeds=", ".join(str(run.config.seed) for run in group),
        learned=f"{len(skilled)} of {len(group)}",
        steps=_spread([e.step for e in skilled]),
        seconds=_spread([e.seconds for e in skilled]),
        cpu_seconds=_spread([e.cpu_seconds for e in skilled]),
        used=_spread([run.steps for run in group]),
        best=", ".join(f"{100 * share:.0f} %" for share in best) or NONE,
    )


def summary_card(group: Group, rows: Sequence[DrivingRow]) -> Card:
    """The group's card: its first evaluation, or what its training has reached."""
    row = learning_row(group)
    facts = [f"learned after {row.steps} steps, {row.seconds} s"] if row.steps != NONE else []
    facts.append(f"trained {row.used} steps")
    steps, running = group[0].config.steps, sum(not run.state.stopped_by for run in group)
    if running:
        facts.append(f"{running} of {len(group)} not finished (of {steps:,} steps)")
    if len(group) > 1:
        facts.append(f"seeds {row.seeds}")
    first = next((one for one in rows if one.group is group and not one.inputs.zero), None)
    if first is None:
        meaning = "best evaluation during training" if row.best != NONE else "no evaluation yet"
        return Card(row.name, row.best, meaning, tuple(facts))
    facts.insert(0, f"{first.distance} from the path on average")
    meaning = f"of {first.episodes} episodes driven to the end, {first.where}"
    return Card(row.name, first.share, meaning, tuple(facts))


def driving_rows(groups: Sequence[Group]) -> list[DrivingRow]:
    """One for each group and conditions of evaluation."""
    rows: list[DrivingRow] = []
    for group in groups:
        alike: dict[Inputs, list[Judgement]] = {}
        for judgement in (j for run in group for j in run.judgements):
            asked = judgement.result.inputs
            same = replace(asked, model=Path(asked.model).name, episodes=0, seed=0)
            alike.setdefault(same, []).append(judgement)
        rows += [_driving_row(group, judgements) for judgements in alike.values()]
    return rows


def _driving_row(group: Group, judgements: Sequence[Judgement]) -> DrivingRow:
    asked, config = judgements[0].result.inputs, group[0].config
    # Ours under their conditions: nothing of the paper's is like an input zeroed.
    like = asked.zero is None and asked.task == config.task
    papers = find_task(asked.task).paper if like else {}
    results = [j.result for j in judgements]
    episodes = sum(r.episodes for r in results)
    successes = episodes - sum(len(r.failures) for r in results)
    share, low = _percent(successes / episodes), _percent(wilson_low(successes, episodes))
    lane_m, time_s, off_m_s, outside_s = (
        sum(r.episodes * figure for r, figure in zip(results, column, strict=True)) / episodes
        for column in zip(*map(_figures, judgements), strict=True)
    )
    logs = [j.drives for j in judgements if j.drives is not None]
    worst = sorted((t for log in logs for t in log.worst), key=lambda t: t.badness, reverse=True)
    return DrivingRow(
        group=group,
        inputs=asked,
        name=describe(group),
        where=_where(asked, config.task),
        paper=papers.get(config.algorithm, PaperRow()),
        episodes=episodes,
        successes=successes,
        share=share,
        success=f"{share} ({successes} of {episodes}; at least {low})",
        by_run=", ".join(_percent(r.success_rate) for r in results) if len(results) > 1 else NONE,
        distance=f"{100 * off_m_s / time_s:.1f} cm",
        olympics=(
            f"{lane_m:.1f} m",
            f"{time_s:.1f} s",
            f"{off_m_s:.2f} m·s",
            f"{outside_s:.2f} s",
        ),
        tracks=tuple(track for log in logs for track in log.tracks),
        worst=tuple(worst),
    )


def _figures(judgement: Judgement) -> tuple[float, float, float, float]:
    r = judgement.result
    deviation_m_s = r.mean_path_distance_m * r.survival_time_s
    return r.driven_lane_m, r.survival_time_s, deviation_m_s, r.outside_lane_s


def _where(asked: Inputs, learned: str) -> str:
    maps = ", ".join(Path(name).stem for name in asked.maps)
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


def _pose(asked: Inputs) -> str:
    """How wrong the overhead poses were."""
    if asked.pose_error == "none" or (asked.pose_error is None and asked.look == "nominal"):
        return "true pose"
    return f"pose error {asked.pose_error or 'of the look'}"


def _percent(share: float) -> str:
    return f"{100 * share:.1f} %"


def _spread(values: Sequence[float]) -> str:
    """Median, and lowest to highest where there are several."""
    values = [value for value in values if not math.isnan(value)]
    if not values:
        return NONE
    between = f" ({min(values):,.0f} to {max(values):,.0f})" if len(values) > 1 else ""
    return f"{median(values):,.0f}{between}"
