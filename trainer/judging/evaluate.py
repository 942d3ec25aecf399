"""Drive an exported policy through whole camera frames, as the robot does, and count.

The figures are those of the AI Driving Olympics (see `sim_pybullet.batch`) beside the
share of episodes that succeeded.
"""

from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np

from robot.contract import CONTROL_DT_S, MAX_WHEEL_MPS
from robot.errors import ConfigError
from robot.inference.policy import (
    TOLERANCE,
    OnnxPolicy,
    TranslatingPolicy,
    open_translator,
    read_contract,
)
from robot.inference.preprocess import preprocess_batch
from sim_pybullet.batch import BatchStep, BatchWorld, DriveMetrics, Observation
from sim_pybullet.episodes import Looks
from sim_pybullet.look import NOMINAL, Look
from sim_pybullet.scenery.objects import Place
from sim_pybullet.sensing.guidance_feed import ALWAYS, PoseSources
from sim_pybullet.tasks.spec import MAX_HEADING_ERROR_RAD, Choices, find_task
from trainer.judging.intervals import share
from trainer.options import EvaluateOptions

FILM_S = 10.0  # of what a robot saw is kept
SETTLED = 20  # decisions after which a robot should have got over where it was put
DONE = "done"

Film = Sequence[np.ndarray]  # frames (H, W, 3) uint8 RGB, one each decision


@dataclass
class Ride:
    """One robot's episode that goes on."""

    poses: list[np.ndarray] = field(default_factory=list)
    frames: deque[np.ndarray] = field(
        default_factory=lambda: deque(maxlen=round(FILM_S / CONTROL_DT_S))
    )
    farthest: Film = ()  # what was seen up to where it was farthest off
    farthest_m: float = 0.0  # from its path, once it was over its start
    half_lane_m: float = 0.0
    end: str = ""  # `DONE`, or why it failed
    look: Look = NOMINAL

    def add(self, pose: np.ndarray, offset_m: float, frame: np.ndarray | None) -> None:
        """Before a decision: where it is, and what it sees, if that is kept."""
        self.poses.append(pose)
        if frame is not None:
            self.frames.append(frame.copy())
        if len(self.poses) > SETTLED and abs(offset_m) > self.farthest_m:
            self.farthest, self.farthest_m = tuple(self.frames), abs(offset_m)


class Drive(NamedTuple):
    """One episode."""

    seed: int
    success: bool
    metrics: DriveMetrics
    failed: bool = False  # off the lane, lost or in collision, not just out of time
    laps: float | None = None  # driven, where the task counts them
    collided: bool = False  # the drive ended in a collision
    map: str = ""
    lane: str | None = None  # of a ring


def drive(
    world: BatchWorld, choose: Callable[[Observation], np.ndarray], films: bool = True
) -> Iterator[tuple[Drive, dict[str, float], Ride]]:
    """The episodes of a world with numbered ones, as each ends; the world is closed after them.

    With the task's facts at its end, and the ride, with frames where ``films`` are asked for.
    ``choose`` gives what `BatchWorld.step` takes.
    """
    going = [Ride() for _ in range(world.n_robots)]
    try:
        seen = world.reset()
        while world.active.any():
            task, poses = world.task, world.poses
            for i in np.flatnonzero(world.active).tolist():
                going[i].half_lane_m = float(task.half_lane_m[i])
                frame = seen.image[i, ..., -3:] if films else None
                going[i].add(poses[i], float(task.course.offset_m[i]), frame)
            numbers, maps, looks = world.numbers, world.maps, world.looks
            step = world.step(choose(seen))
            seen = step.observation
            for k, robot in enumerate(step.finished.robots.tolist()):
                told = zip(task.fact_names, step.task.facts[:, robot].tolist(), strict=True)
                facts, failed = dict(told), bool(step.task.terminated[robot])
                collided, place = bool(step.collided[robot]), task.road_maps[maps[robot]].name
                number, success = int(numbers[robot]), bool(step.task.success[robot])
                how = failed, facts.get("laps"), failed and collided
                done = Drive(number, success, step.finished.metrics[k], *how, place)
                ride, going[robot] = going[robot], Ride()
                ride.poses.append(step.poses[robot])
                ride.end, ride.look = _end(step, robot), looks[robot]
                yield done, facts, ride
    finally:
        world.close()


def _end(step: BatchStep, robot: int) -> str:
    if step.task.success[robot]:
        return DONE
    if step.collided[robot]:
        return "collided"
    if not step.task.terminated[robot]:
        return "out of time"
    turned = abs(step.course.heading_error_rad[robot]) > MAX_HEADING_ERROR_RAD
    return "turned away" if turned else "left its path"


_FIRST_WORLD = 1_000_000_007  # seed of all worlds, away from those that runs are trained with

DrivingPolicy = OnnxPolicy | TranslatingPolicy


@dataclass(frozen=True)
class OnMap:
    """The drives on one map, of a ring those along one of its lanes."""

    map: str
    lane: str | None
    part: str | None  # of the maps that this one belongs to, see `trainer.division`
    episodes: int
    succeeded: int
    mean_path_distance_m: float


@dataclass(frozen=True)
class Evaluation:
    """What ``--json`` writes. Means are over episodes unless the name says otherwise."""

    inputs: EvaluateOptions  # filled in
    episodes: int
    success_rate: float
    success_rate_low: float  # lower end of Wilson's 95 % interval
    mean_path_distance_m: float  # over all decisions
    survival_time_s: float
    driven_lane_m: float
    outside_lane_s: float
    failures: tuple[int, ...]  # seeds; ``--seed S --episodes 1`` runs one again
    algorithm: str
    run: str
    collisions: int = 0  # episodes that ended in one
    failed_ends: int = 0  # episodes that ended off the lane, lost or in collision
    laps: float | None = None  # driven in an episode, where the task counts them
    mean_speed_mps: float = 0.0  # of a race car: on the real track
    by_map: tuple[OnMap, ...] = ()
    model_sha256: str = ""  # of the policy's file; once not told
    schema: int = 1


def open_policy(model: str | Path, task: str = "", translate: str | None = None) -> DrivingPolicy:
    """The policy in a file; ``task``: what it shall do, else what it was trained for.

    ``translate``: an ONNX translator before it. For robots it may have any actions that their
    wheels can do. ContractError as of ``OnnxPolicy``; ConfigError for an unknown task, or one of
    another vehicle than the policy's.
    """
    trained_for = read_contract(model).task
    trained = find_task(trained_for)
    if task and find_task(task).wheeled != trained.wheeled:
        told = f"{model}: expected a policy for {task}, got one for {trained_for}; "
        raise ConfigError(f"{told}these are driven by different vehicles")
    policy = OnnxPolicy(model, actions=None if trained.wheeled else trained.actions)
    if translate is None:
        return policy
    return TranslatingPolicy(policy, open_translator(translate, policy.contract.image))


def ridden(
    policy: DrivingPolicy,
    task: str,
    road_maps: Sequence[Place],
    looks: Looks,
    seeds: Sequence[int],
    zero: str | None = None,
    lane: str | None = None,
    sources: PoseSources = ALWAYS,
    films: bool = False,
) -> Iterator[tuple[Drive, Ride]]:
    """One greedy episode for each seed, all at once; as each ends, with frames where ``films``.

    An episode is the same whichever others are driven (`sim_pybullet.episodes.NumberedEpisodes`),
    to the rounding of a robot's place. Consecutive seeds take the maps in turn, and on each map
    both lanes of a ring, or all its manoeuvres. The policy gets zeros for ``zero``: image, path,
    junctions (pictures taken there, sight gets them too) or nothing. ConfigError for a path that is
    not there, or a lane in a task that keeps none.
    """
    task_of_all = find_task(task).build(road_maps, len(seeds), Choices(lane))
    world = BatchWorld(
        *(task_of_all, looks, None, _FIRST_WORLD),
        numbers=seeds,
        sources=sources,
        blank_in_junctions=zero == "junctions",
        commands=policy.contract.commands,
    )
    speeds = _own_speeds(policy, world)

    def choose(seen: Observation) -> np.ndarray:
        choices = np.zeros(world.n_robots, dtype=int)
        for robot in np.flatnonzero(world.active).tolist():
            choices[robot] = _choose(policy, seen, robot, zero)
        return choices if speeds is None else speeds[choices]

    for done, _, ride in drive(world, choose, films):
        yield done._replace(lane=_lane(task, lane, done.seed // len(road_maps))), ride


def summarise(
    inputs: EvaluateOptions,
    policy: DrivingPolicy,
    drives: Sequence[Drive],
    parts: Mapping[str, str | None] | None = None,
) -> Evaluation:
    """The figures of a set of episodes; ``parts`` says of each map to which part it belongs."""
    metrics = [drive.metrics for drive in drives]
    success = share(sum(drive.success for drive in drives), len(drives))
    time_s = sum(m.survival_time_s for m in metrics)
    scale = find_task(inputs.task).scale
    laps = [drive.laps for drive in drives if drive.laps is not None]
    return Evaluation(
        inputs=inputs,
        episodes=len(drives),
        success_rate=success.value,
        success_rate_low=success.low,
        mean_path_distance_m=sum(m.deviation_m_s for m in metrics) / time_s,
        survival_time_s=time_s / len(drives),
        driven_lane_m=float(np.mean([m.driven_lane_m for m in metrics])),
        outside_lane_s=float(np.mean([m.outside_lane_s for m in metrics])),
        failures=tuple(drive.seed for drive in drives if not drive.success),
        algorithm=policy.contract.algorithm,
        run=policy.contract.run,
        collisions=sum(drive.collided for drive in drives),
        failed_ends=sum(drive.failed for drive in drives),
        laps=sum(laps) / len(laps) if laps else None,
        mean_speed_mps=sum(m.driven_lane_m for m in metrics) / time_s / scale,
        by_map=_by_map(drives, parts or {}),
    )


def _by_map(drives: Sequence[Drive], parts: Mapping[str, str | None]) -> tuple[OnMap, ...]:
    groups: dict[tuple[str, str | None], list[Drive]] = {}
    for drive in drives:
        groups.setdefault((drive.map, drive.lane), []).append(drive)
    rows = []
    for (name, lane), group in groups.items():
        time_s = sum(drive.metrics.survival_time_s for drive in group)
        offset_m = sum(drive.metrics.deviation_m_s for drive in group) / time_s
        succeeded = sum(drive.success for drive in group)
        rows.append(OnMap(name, lane, parts.get(name), len(group), succeeded, offset_m))
    return tuple(sorted(rows, key=lambda row: (row.map, row.lane or "")))


def _lane(task: str, lane: str | None, turn: int) -> str | None:
    """Which lane of its ring an episode is on: of both they take turns."""
    lanes = find_task(task).lanes
    if not lanes:
        return None
    return lanes[turn % 2] if lane == "both" else lane or lanes[0]


def _own_speeds(policy: DrivingPolicy, world: BatchWorld) -> np.ndarray | None:
    """(A, 2) shares of the greatest wheel speed, of a policy with other actions than the task's."""
    own, usual = np.array(policy.contract.actions), np.array(world.task.vehicle.actions)
    same = own.shape == usual.shape and np.allclose(own, usual, 0.0, TOLERANCE)
    return None if same else np.clip(own / MAX_WHEEL_MPS, -1.0, 1.0)


def _choose(policy: DrivingPolicy, seen: Observation, robot: int, zero: str | None) -> np.ndarray:
    """Of one robot, as on a robot: in a batch rounding depends on how many others there are."""
    stack = seen.image[robot : robot + 1]
    stack = stack[..., -3 * policy.contract.frames :]  # it may know fewer than the task has
    frames = [stack[..., k : k + 3] for k in range(0, stack.shape[-1], 3)]
    pictures = [preprocess_batch(frame, policy.contract.image) for frame in frames]
    picture = np.concatenate(pictures, axis=-1)
    path = None if seen.path is None else seen.path[robot : robot + 1]
    if zero == "image":
        picture = np.zeros_like(picture)
    elif zero == "path":
        if path is None or not policy.contract.path_points:
            raise ConfigError("zero: expected image, got path; this task gives none")
        path = path.copy()
        path[:, : policy.contract.path_points] = 0.0
    return policy.values(picture, path).argmax(axis=1)[0]
