"""``Task``: what a batch of robots is asked to do; ``TaskSpec``: all that others must know of it.

Trainings, evaluations, reports, model cards and Gymnasium ids look tasks up by name. A task of
one's own is a file that calls `register`; see ``examples/own_task.py``.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import gymnasium
import numpy as np

from robot.contract import FIVE_ACTIONS, PATH_POINTS, ActionTable
from robot.errors import ConfigError, expect_one_of
from robot.geometry import Pose, wrap_angle
from robot.navigation.path import Path, PathBatch
from robot.navigation.road_map import load_map
from sim_pybullet.randomise import load_look_sampler

if TYPE_CHECKING:
    from sim_pybullet.episodes import Looks
    from sim_pybullet.motors import WheeledRobots
    from sim_pybullet.scene import Mover
    from sim_pybullet.scenery.objects import Place
    from sim_pybullet.tasks.track_racing import RacingCars

MAX_HEADING_ERROR_RAD = math.radians(100.0)
START_OFFSET = 0.25  # at most, in half-lane widths
START_HEADING_RAD = math.radians(10.0)  # at most

Mission = tuple[Path, float]  # and how far along it an episode begins [m]


class Course(NamedTuple):
    """Where N robots are on the paths they should follow."""

    arc_m: np.ndarray  # (N,) along the path
    offset_m: np.ndarray  # (N,) from the path, positive to the left
    heading_error_rad: np.ndarray  # (N,) the robot's heading less the path's, in (-pi, pi]
    progress_m: np.ndarray  # (N,) along the path in the last decision
    travelled_m: np.ndarray  # (N,) along the path in this episode


class TaskStep(NamedTuple):
    """What one decision of N robots led to. The reward is the sum of its terms."""

    terms: np.ndarray  # (T, N), in the order of the task's term_names
    facts: np.ndarray  # (F, N), in the order of the task's fact_names
    terminated: np.ndarray  # (N,) bool: failed, nothing more to be gained
    truncated: np.ndarray  # (N,) bool: cut off, by success or by the step limit
    success: np.ndarray  # (N,) bool

    @property
    def reward(self) -> np.ndarray:
        """(N,)."""
        return np.asarray(self.terms.sum(axis=0))


def expect_any(task: str, maps: Sequence[object], robots: int, laps: float = 1.0) -> None:
    """ConfigError without maps, robots or laps."""
    if not maps or robots < 1 or not laps > 0.0:
        raise ConfigError(
            f"{task}: expected at least one map, one robot and laps above 0, got "
            f"{len(maps)} maps, {robots} robots, {laps} laps"
        )


class Task(ABC):
    """A path for each robot to follow, each in an episode of its own, on a random map.

    ``half_widths_m`` (M,) are the distances from the path at which a robot leaves its lane;
    ``start_spread`` multiplies how far from the path and how askew an episode may begin, for
    training: good drivers hardly ever see the edge of the lane; there they learn to return.
    ``paths`` are those to follow now, on ``maps`` (N,), indices into ``road_maps``; ``course``
    says where the robots are on them, ``met`` (N,) bool who has met somebody without touching.
    """

    guided = False  # whether the policy gets path_input beside the picture
    group = 1  # robots that share a world: so many, one behind the other in the batch
    movers: tuple[Mover, ...] = ()  # what moves in those worlds
    frames = 1  # how many of the last pictures the policy gets
    term_names: tuple[str, ...]  # of the reward
    fact_names: tuple[str, ...]  # of what else is worth knowing of a robot's episode

    def __init__(
        self,
        road_maps: Sequence[Place],
        vehicle: WheeledRobots | RacingCars,
        n_robots: int,
        half_widths_m: np.ndarray,
        path: Path,
        start_spread: float = 1.0,
    ) -> None:
        self.n_robots, self.vehicle = n_robots, vehicle
        self.road_maps = tuple(road_maps)
        self.paths = PathBatch([path] * n_robots)
        self.course = Course(*np.zeros((len(Course._fields), n_robots)))
        self.met = np.zeros(n_robots, dtype=bool)
        self._half_widths_m, self._spread = half_widths_m, start_spread
        self._lengths_m = np.zeros(n_robots)  # of the robots' paths
        self.maps = np.zeros(n_robots, dtype=int)
        self._steps = np.zeros(n_robots, dtype=int)
        self._hints = np.zeros(n_robots, dtype=int)

    @property
    def half_lane_m(self) -> np.ndarray:
        """(N,) distance from the path at which a robot leaves its lane."""
        return np.asarray(self._half_widths_m[self.maps])

    def reset(
        self, robots: np.ndarray, rng: np.random.Generator, number: int | None = None
    ) -> np.ndarray:
        """Begin an episode for these robots: indices (M,); their poses (M, 3).

        With a number, what could be drawn among several (map, lane, manoeuvre) is taken in turn.
        """
        count = len(self.road_maps)
        maps = rng.integers(count, size=len(robots))
        turn = None
        if number is not None:
            maps[:], turn = number % count, number // count
        poses = np.zeros((len(robots), 3))
        for k, (i, m) in enumerate(zip(robots.tolist(), maps.tolist(), strict=True)):
            path, arc_m = self._mission(m, rng, turn)
            most_m = self._spread * START_OFFSET * self._half_widths_m[m]
            offset_m = rng.uniform(-most_m, most_m)
            most_rad = self._spread * START_HEADING_RAD
            heading_rad = rng.uniform(-most_rad, most_rad)
            self._start(i, path, m, arc_m, offset_m, heading_rad)
            place = path.pose_at(arc_m)
            poses[k, :2] = place.to_world(np.array((0.0, offset_m)))
            poses[k, 2] = wrap_angle(place.heading_rad + heading_rad)
        return poses

    def reset_at(self, robots: np.ndarray, poses: np.ndarray, rng: np.random.Generator) -> None:
        """Begin an episode for these robots (M,) at these poses (M, 3) of the only map.

        ConfigError if there are several maps, or a pose is off the road or turned away from it.
        """
        if len(self.road_maps) > 1:
            raise ConfigError(f"pose: expected to drive on one map, got {len(self.road_maps)}")
        for i, pose in zip(robots.tolist(), poses.tolist(), strict=True):
            path = self._path_from(Pose(*pose), rng)
            at = path.project(pose[0], pose[1])
            turned_rad = float(wrap_angle(pose[2] - at.heading_rad))
            most_m, most_rad = float(self._half_widths_m[0]), MAX_HEADING_ERROR_RAD
            if abs(at.offset_m) > most_m or abs(turned_rad) > most_rad:
                near = path.pose_at(at.arc_m)
                raise ConfigError(
                    f"pose: expected one within {most_m:.2f} m and {most_rad:.2f} rad of the lane, "
                    f"such as ({near.x_m:.2f}, {near.y_m:.2f}, {near.heading_rad:.2f}), got "
                    f"({pose[0]:.2f}, {pose[1]:.2f}, {pose[2]:.2f})"
                )
            self._start(i, path, 0, at.arc_m, at.offset_m, turned_rad)

    def think(self, poses: np.ndarray) -> None:  # noqa: B027
        """At the beginning of a decision, robots at poses (N, 3): other road users decide too."""

    def moving(self, poses: np.ndarray, share: float = 1.0) -> np.ndarray | None:  # noqa: ARG002
        """(N, U, 3) poses of the ``movers`` round each robot, NaN where one is not there.

        ``share`` of the decision has passed, and the robots are at poses (N, 3).
        """
        return None

    def expert(self, poses: np.ndarray) -> np.ndarray:
        """(N,) what an expert would do now, who knows the true poses (N, 3)."""
        return self.vehicle.expert(self.paths, poses, self.course.arc_m)

    @abstractmethod
    def step(self, poses: np.ndarray, collided: np.ndarray) -> TaskStep:
        """Judge one decision by the poses (N, 3) that it led to; ``collided`` is (N,) bool."""

    @abstractmethod
    def _mission(self, road_map: int, rng: np.random.Generator, turn: int | None) -> Mission:
        """The path of a robot's next episode on a map, and how far along it [m] it begins.
        ``turn``: what episodes on this map take in turn, their number there; None where they
        draw."""

    def _judged(
        self, terms: np.ndarray, facts: np.ndarray, ends: tuple[np.ndarray, np.ndarray, np.ndarray]
    ) -> TaskStep:
        """A step by who (N,) has failed, arrived or run out of time."""
        failed, arrived, late = ends
        return TaskStep(terms, facts, failed, ~failed & (arrived | late), ~failed & arrived)

    def _path_from(self, pose: Pose, rng: np.random.Generator) -> Path:  # noqa: ARG002
        """The path of an episode that begins at a pose of the first map."""
        return self._mission(0, rng, None)[0]

    def _start(
        self, i: int, path: Path, road_map: int, arc_m: float, offset_m: float, turned_rad: float
    ) -> None:
        """Begin an episode of robot ``i`` beside a point of a path."""
        self.paths.replace(i, path)
        self.course = Course(*(each.copy() for each in self.course))  # the old one was given away
        for each, value in zip(self.course, (arc_m, offset_m, turned_rad, 0, 0), strict=True):
            each[i] = value
        self._hints[i] = self.paths.index_at(self.course.arc_m)[i]
        self._lengths_m[i], self.maps[i], self._steps[i] = path.length_m, road_map, 0

    def _follow(self, poses: np.ndarray) -> tuple[Course, np.ndarray]:
        """One more decision: where it led to, and who (N,) has turned away from the path."""
        at = self.paths.project(poses[:, :2], self._hints)
        progress_m = self.paths.advance_m(self.course.arc_m, at.arc_m)
        error = np.asarray(wrap_angle(poses[:, 2] - at.heading_rad))
        travelled_m = self.course.travelled_m + progress_m
        self._hints = at.index
        self.course = Course(at.arc_m.copy(), at.offset_m, error, progress_m, travelled_m)
        self._steps += 1
        return self.course, np.abs(error) > MAX_HEADING_ERROR_RAD


Changes = Mapping[str, Any]  # of a configuration, by field; of a nested one again a mapping


@dataclass(frozen=True)
class Choices:
    """What else may be asked of a task; none for what a task has no use for."""

    lane: str | None = None  # of a ring of road
    style: str | None = None  # of driving
    laps: float | None = None  # of an episode
    start_spread: float = 1.0  # above 1 in practice: begin farther off, in shorter episodes
    scenario: Any = None  # of road users: a file or a shipped name


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
    actions: ActionTable = FIVE_ACTIONS
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
        return self.actions[: len(FIVE_ACTIONS)] == FIVE_ACTIONS

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
            if value is not None and isinstance(of_use, tuple):
                expect_one_of(name, value, of_use)
        if self.make is None:
            return self.kind(places, robots, start_spread=chosen.start_spread)  # type: ignore[call-arg, arg-type]
        return self.make(places, robots, chosen)


TASKS: dict[str, TaskSpec] = {}  # all that are known


def register(spec: TaskSpec) -> TaskSpec:
    """Make a task, and its environments, known by name; ConfigError if another has that name."""
    if spec.name in TASKS:
        raise ConfigError(f"task: expected a name of its own, got {spec.name!r} again")
    TASKS[spec.name] = spec
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
    expect_one_of("task", name, valid)
    return valid[name]


def learned_tasks() -> list[TaskSpec]:
    """Those that policies are trained for."""
    return [spec for spec in TASKS.values() if spec.learned]
