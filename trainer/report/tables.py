"""The figures of groups of runs, ready to be put into tables beside the paper's."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median

import numpy as np

from robot.errors import ConfigError
from sim_pybullet.look import NOMINAL
from sim_pybullet.randomise import load_look_sampler
from sim_pybullet.tasks.spec import PaperRow, find_task
from trainer.algorithms import find_algorithm
from trainer.judging.drive_log import Track
from trainer.judging.evaluate import Inputs, wilson_low
from trainer.report.runs import Group, Judgement

NONE = "–"
_NAMED_MAPS = 2  # at most, where there is little room


@dataclass(frozen=True)
class LearningRow:
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


@dataclass(frozen=True)
class Card:
    """What a group has come to, in one figure and a few words."""

    name: str
    figure: str
    meaning: str
    facts: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class DrivingRow:
    """How the exported policies of a group drove under the same conditions."""

    group: Group
    judgements: tuple[Judgement, ...]

    @property
    def inputs(self) -> Inputs:
        """Of the first; the others differ in model and seeds."""
        return self.judgements[0].result.inputs

    @property
    def name(self) -> str:
        """What drove."""
        return describe(self.group)

    @property
    def where(self) -> str:
        """On which maps, in which looks, with which pose error."""
        asked = self.inputs
        maps = ", ".join(Path(name).stem for name in asked.maps)
        guided = f" · {_pose(asked)}" if find_task(asked.task).path_points else ""
        without = f" · {asked.zero} zeroed" if asked.zero else ""
        model = Path(asked.model).name
        if asked.task != self.group.config.task:
            maps = f"{asked.task} on {maps}"
        if asked.translate:
            without += f" · through {Path(asked.translate).stem}"
        return f"{maps} · {Path(asked.look).stem}{guided}{without}" + (
            "" if model == "model.onnx" else f" · {model}"
        )

    @property
    def paper(self) -> PaperRow:
        """Ours under their conditions: nothing of the paper's is like an input zeroed."""
        asked, config = self.inputs, self.group.config
        like = asked.zero is None and asked.task == config.task
        return find_task(asked.task).paper.get(config.algorithm, PaperRow()) if like else PaperRow()

    @property
    def episodes(self) -> int:
        """Of all seeds together."""
        return sum(j.result.episodes for j in self.judgements)

    @property
    def successes(self) -> int:
        """Of all seeds together."""
        return sum(j.result.episodes - len(j.result.failures) for j in self.judgements)

    @property
    def success(self) -> str:
        """Share of episodes, with the lower end of its 95 % interval."""
        low = wilson_low(self.successes, self.episodes)
        return (
            f"{_percent(self.successes / self.episodes)} ({self.successes} of {self.episodes}; "
            f"at least {_percent(low)})"
        )

    @property
    def by_run(self) -> str:
        """The success of each run."""
        shares = [j.result.success_rate for j in self.judgements]
        return ", ".join(map(_percent, shares)) if len(shares) > 1 else NONE

    @property
    def distance(self) -> str:
        """Mean distance from the path, over all decisions."""
        results = [j.result for j in self.judgements]
        time_s = sum(r.survival_time_s * r.episodes for r in results)
        each = (r.mean_path_distance_m * r.survival_time_s * r.episodes for r in results)
        return f"{100 * sum(each) / time_s:.1f} cm"

    @property
    def olympics(self) -> tuple[str, str, str, str]:
        """Driven in the lane, survival, deviation over time, time outside; means per episode."""
        return (
            f"{self._mean('driven_lane_m'):.1f} m",
            f"{self._mean('survival_time_s'):.1f} s",
            f"{self._deviation_m_s():.2f} m·s",
            f"{self._mean('outside_lane_s'):.2f} s",
        )

    @property
    def tracks(self) -> list[Track]:
        """Of all seeds that kept theirs."""
        return [t for j in self.judgements if j.drives is not None for t in j.drives.tracks]

    @property
    def worst(self) -> list[Track]:
        """Those with film strips, the worst first."""
        kept = [t for j in self.judgements if j.drives is not None for t in j.drives.worst]
        return sorted(kept, key=lambda track: track.badness, reverse=True)

    def _mean(self, field: str) -> float:
        whole = sum(getattr(j.result, field) * j.result.episodes for j in self.judgements)
        return float(whole) / self.episodes

    def _deviation_m_s(self) -> float:
        results = [j.result for j in self.judgements]
        whole = sum(r.mean_path_distance_m * r.survival_time_s * r.episodes for r in results)
        return whole / self.episodes


def describe(group: Group) -> str:
    """Algorithm, preset, and what of maps, look and pose error is not the default."""
    config = group.config
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
    skilled = [run.skilled for run in group.runs if run.skilled is not None]
    best = [run.state.best.success_rate for run in group.runs if run.state.best is not None]
    return LearningRow(
        name=describe(group),
        paper=find_task(group.config.task).paper.get(group.config.algorithm, PaperRow()),
        seeds=", ".join(map(str, group.seeds)),
        learned=f"{len(skilled)} of {len(group.runs)}",
        steps=_spread([e.step for e in skilled]),
        seconds=_spread([e.seconds for e in skilled]),
        cpu_seconds=_spread([e.cpu_seconds for e in skilled]),
        used=_spread([run.steps for run in group.runs]),
        best=", ".join(f"{100 * share:.0f} %" for share in best) or NONE,
    )


def summary_card(group: Group, rows: Sequence[DrivingRow]) -> Card:
    """The group's card: its first evaluation, or what its training has reached."""
    row = learning_row(group)
    facts = [f"learned after {row.steps} steps, {row.seconds} s"] if row.steps != NONE else []
    facts.append(f"trained {row.used} steps")
    steps, running = group.config.steps, sum(not run.state.stopped_by for run in group.runs)
    if running:
        facts.append(f"{running} of {len(group.runs)} not finished (of {steps:,} steps)")
    if len(group.runs) > 1:
        facts.append(f"seeds {row.seeds}")
    mine = [one for one in rows if one.group is group and not one.inputs.zero]
    if mine:
        first = mine[0]
        facts.insert(0, f"{first.distance} from the path on average")
        meaning = f"of {first.episodes} episodes driven to the end, {first.where}"
        return Card(row.name, _percent(first.successes / first.episodes), meaning, tuple(facts))
    meaning = "best evaluation during training" if row.best != NONE else "no evaluation yet"
    return Card(row.name, row.best, meaning, tuple(facts))


def driving_rows(groups: Sequence[Group]) -> list[DrivingRow]:
    """One for each group and conditions of evaluation."""
    rows: list[DrivingRow] = []
    for group in groups:
        alike: dict[Inputs, list[Judgement]] = {}
        for judgement in (j for run in group.runs for j in run.judgements):
            asked = judgement.result.inputs
            same = replace(asked, model=Path(asked.model).name, episodes=0, seed=0)
            alike.setdefault(same, []).append(judgement)
        rows += [DrivingRow(group, tuple(judgements)) for judgements in alike.values()]
    return rows


def _percent(share: float) -> str:
    return f"{100 * share:.1f} %"


def _pose(asked: Inputs) -> str:
    """How wrong the overhead poses were."""
    if asked.pose_error not in (None, "none"):
        return f"pose error {asked.pose_error}"
    try:
        pose = load_look_sampler(asked.look, asked.pose_error)(np.random.default_rng(0)).pose
    except ConfigError:  # its file is gone
        return "pose error of the look"
    return "true pose" if pose == NOMINAL.pose else "pose error of the look"


def _spread(values: Sequence[float]) -> str:
    """Median, and lowest to highest where there are several."""
    values = [value for value in values if not math.isnan(value)]
    if not values:
        return NONE
    middle = f"{median(values):,.0f}"
    if len(values) == 1:
        return middle
    return f"{middle} ({min(values):,.0f} to {max(values):,.0f})"
