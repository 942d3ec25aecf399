"""``TaskSpec``: all that the rest of the project must know of a task, in the task's own file.

Trainings, evaluations, reports, model cards and Gymnasium ids look tasks up by name. A task of
one's own is a file that calls `register`; see ``examples/own_task.py``.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from robot.contract import ACTION_WHEELS, PATH_POINTS, ActionTable
from robot.errors import ConfigError, nearest
from robot.navigation.road_map import load_map
from sim_pybullet.randomise import load_look_sampler
from sim_pybullet.tasks.base import Task

if TYPE_CHECKING:
    from sim_pybullet.episodes import Looks
    from sim_pybullet.scenery.objects import Place

WHEELED: ActionTable = tuple((wheels[0], wheels[1]) for wheels in ACTION_WHEELS)

Changes = Mapping[str, Any]  # of a configuration, by field; of a nested one again a mapping


@dataclass(frozen=True)
class Choices:
    """What else may be asked of a task; none for what a task has no use for."""

    lane: str | None = None  # of a ring of road
    style: str | None = None  # of driving
    laps: float | None = None  # of an episode
    start_spread: float = 1.0  # above 1 in practice: begin farther off, in shorter episodes
    scenario: str | None = None  # of road users: a file or a shipped name


@dataclass(frozen=True)
class PaperRow:
    """What paper A says of one algorithm on a task; strings are shown as they are."""

    learned: str = "–"  # steps until it had learned
    trained: str = "–"  # steps of the whole training
    driving: str = "–"  # how the trained model drove


@dataclass(frozen=True)
class TaskSpec:
    """One task, by name."""

    name: str
    title: str  # above its part of a report
    purpose: str  # of its policies, a sentence or two of Markdown
    kind: type[Task]
    map: str  # where it is learned and judged unless somebody says where
    make: Callable[[Sequence[Any], int, Choices], Task] | None = None  # else of kind alone
    load: Callable[[str], Place] = load_map
    looks: Callable[..., Looks] = load_look_sampler  # of a source, a pose error, and exceptions
    actions: ActionTable = WHEELED
    lanes: tuple[str, ...] = ()  # to choose among; the first is usual
    styles: tuple[str, ...] = ()  # likewise
    counts_laps: bool = False  # whether laps may be asked for
    scenarios: bool = False  # whether a scenario of road users may
    learned: bool = True  # False: only judged
    painted: int = 48  # worlds of a training over all maps: a second and 160 MB for eight of them
    scale: float = 1.0  # metres of the simulator per metre of the real thing
    # By preset or style, see `trainer.presets`; of ``learn`` what the algorithm has counts.
    presets: Mapping[str, Changes] = field(default_factory=dict)
    paper: Mapping[str, PaperRow] = field(default_factory=dict)  # by algorithm, in its order
    environments: Mapping[str, Changes] = field(default_factory=dict)  # Gymnasium ids' arguments

    @property
    def path_points(self) -> int:
        """How many angles of the path a policy gets beside the picture."""
        return PATH_POINTS if self.kind.guided else 0

    @property
    def wheeled(self) -> bool:
        """Whether the project's robot carries out its actions."""
        return self.actions[: len(WHEELED)] == WHEELED

    @property
    def frames(self) -> int:
        """How many of the last pictures a policy gets."""
        return self.kind.frames

    def build(self, places: Sequence[Place], robots: int, chosen: Choices = Choices()) -> Task:
        """The task for so many robots.

        ConfigError for a choice that it has no use for, MapError for a map not fit for it.
        """
        useful = {"lane": self.lanes, "style": self.styles, "laps": self.counts_laps}
        useful["scenario"] = self.scenarios
        for name, of_use in useful.items():
            value = getattr(chosen, name)
            if value is not None and not of_use:
                raise ConfigError(f"{name}: expected none for the task {self.name}, got {value!r}")
        if self.make is None:
            return self.kind(places, robots, start_spread=chosen.start_spread)  # type: ignore[call-arg, arg-type]
        return self.make(places, robots, chosen)


TASKS: dict[str, TaskSpec] = {}  # all that are known


def register(spec: TaskSpec) -> TaskSpec:
    """Make a task, and its environments, known by name; ConfigError if another has that name."""
    if spec.name in TASKS:
        raise ConfigError(f"task: expected a name of its own, got {spec.name!r} again")
    TASKS[spec.name] = spec
    if spec.environments and importlib.util.find_spec("gymnasium"):
        import gymnasium

        for name, arguments in spec.environments.items():
            gymnasium.register(
                f"duckpilot/{name}",
                "sim_pybullet.env:make",
                vector_entry_point="sim_pybullet.env:make_vector",
                kwargs={"task": spec.name, **arguments},
            )
    return spec


def find_task(name: str, to_learn: bool = False) -> TaskSpec:
    """The task of that name, ``to_learn`` if asked; else ConfigError with the nearest."""
    valid = {key: spec for key, spec in TASKS.items() if spec.learned or not to_learn}
    if name not in valid:
        raise ConfigError(f"task: unknown {name!r}; {nearest(name, valid)}")
    return valid[name]


def learned_tasks() -> list[TaskSpec]:
    """Those that policies are trained for."""
    return [spec for spec in TASKS.values() if spec.learned]
