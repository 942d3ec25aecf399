"""Drive an exported policy through whole camera frames, as the robot does, and count.

The figures are those of the AI Driving Olympics (see `sim_pybullet.drive_metrics`) beside the
share of episodes that succeeded.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from robot.contract import PolicyContract
from robot.errors import ConfigError
from robot.inference.network_file import read_metadata
from robot.inference.policy import OnnxPolicy
from robot.inference.policy_file import REMEDY
from robot.inference.preprocess import preprocess_batch
from robot.inference.translator import TranslatingPolicy
from sim_pybullet.batch import BatchWorld, Observation
from sim_pybullet.drive_metrics import DriveMetrics
from sim_pybullet.pool import Looks
from sim_pybullet.racing.racing_cars import RACING_ACTIONS
from sim_pybullet.racing.track import SCALE
from sim_pybullet.scenery.place import Place
from sim_pybullet.tasks import manoeuvres
from trainer.config import choose
from trainer.envs import build_task
from trainer.judging.drive_log import DriveLog, Tracer

ROBOTS = 20  # at once
# Episodes of each robot in one world. Missions differ in length: were each the only one of its
# robot, most robots would wait most of the time.
ROUNDS = {"lane": 1, "four_laps": 1, "navigation": 5, "manoeuvres": manoeuvres.ROUNDS, "track": 1}
_FEWEST_LOOKS = 4  # of each map in one world
_FIRST_WORLD = 1_000_000_007  # seeds of worlds, away from those that runs are trained with

DrivingPolicy = OnnxPolicy | TranslatingPolicy


class Drive(NamedTuple):
    """One episode."""

    seed: int
    success: bool
    metrics: DriveMetrics
    failed: bool = False  # off the lane, lost or in collision, not just out of time
    laps: float | None = None  # driven, where the task counts them


@dataclass(frozen=True)
class Inputs:
    """What was asked for."""

    model: str
    task: str
    maps: tuple[str, ...]
    look: str
    pose_error: str | None  # in place of the look's own
    zero: str | None  # image or path, what the policy got zeros for
    episodes: int
    seed: int
    translate: str | None = None  # the translator between picture and policy
    without: tuple[str, ...] = ()  # what of the look stays nominal


@dataclass(frozen=True)
class Evaluation:
    """What ``--json`` writes. Means are over episodes unless the name says otherwise."""

    inputs: Inputs
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
    collisions: int = 0  # episodes that ended off the lane, lost or in collision
    laps: float | None = None  # driven in an episode, where the task counts them
    mean_speed_mps: float = 0.0  # of a race car: on the real track
    schema: int = 1


def open_policy(model: Path, task: str | None = None) -> OnnxPolicy:
    """The policy in a file, for robots or for race cars; ``task``: what it shall do, if known.

    Raises:
        ContractError: see ``OnnxPolicy``.
        ConfigError: a robot's policy shall race, or a race car's policy drive a robot.
    """
    trained_for = json.loads(read_metadata(model, PolicyContract.METADATA_KEY, REMEDY)).get("task")
    races = trained_for == "track"
    if task is not None and (task == "track") != races:
        raise ConfigError(
            f"{model}: expected a policy for {task}, got one for {trained_for}; "
            "race tracks and Duckietown roads are driven by different vehicles"
        )
    return OnnxPolicy(model, actions=RACING_ACTIONS) if races else OnnxPolicy(model)


def evaluate(
    policy: DrivingPolicy,
    task: str,
    road_maps: Sequence[Place],
    looks: Looks,
    seeds: range,
    finished: Callable[[Drive], None],
    zero: str | None = None,
    log: DriveLog | None = None,
) -> list[Drive]:
    """One greedy episode for each seed; ``finished`` hears of each, ``log`` gets its track.

    In each world every robot drives the task's ROUNDS, one episode after the other, and these have
    the next seeds. All of its robots always drive along: so an episode is the same whichever seeds
    are asked for together with it. The policy gets zeros for ``zero``: image, path or nothing.

    Raises:
        ConfigError: the path shall be zero in a task that has none.
    """
    drives: list[Drive] = []
    rounds = choose("task", task, ROUNDS)
    pool_size = max(ROBOTS // len(road_maps), _FEWEST_LOOKS)
    for group in range(seeds.start // (ROBOTS * rounds), (seeds.stop - 1) // (ROBOTS * rounds) + 1):
        numbers = (np.arange(ROBOTS * rounds) + group * ROBOTS * rounds).reshape(ROBOTS, rounds)
        wanted = (numbers >= seeds.start) & (numbers < seeds.stop)
        world = BatchWorld(
            build_task(task, road_maps, ROBOTS),
            looks,
            seed=_FIRST_WORLD + group,
            pool_size=pool_size,
        )
        tracer = None if log is None else Tracer(world, np.where(wanted, numbers, -1), log)
        try:
            for episode, drive in _drive(policy, world, wanted, zero, tracer):
                drives.append(drive._replace(seed=int(numbers[episode])))
                finished(drives[-1])
        finally:
            world.close()
    return sorted(drives)


def summarise(inputs: Inputs, policy: DrivingPolicy, drives: Sequence[Drive]) -> Evaluation:
    """The figures of a set of episodes."""
    metrics = [drive.metrics for drive in drives]
    successes = sum(drive.success for drive in drives)
    time_s = sum(m.survival_time_s for m in metrics)
    scale = SCALE if inputs.task == "track" else 1.0
    laps = [drive.laps for drive in drives if drive.laps is not None]
    return Evaluation(
        inputs=inputs,
        episodes=len(drives),
        success_rate=successes / len(drives),
        success_rate_low=wilson_low(successes, len(drives)),
        mean_path_distance_m=sum(m.deviation_m_s for m in metrics) / time_s,
        survival_time_s=time_s / len(drives),
        driven_lane_m=float(np.mean([m.driven_lane_m for m in metrics])),
        outside_lane_s=float(np.mean([m.outside_lane_s for m in metrics])),
        failures=tuple(drive.seed for drive in drives if not drive.success),
        algorithm=policy.contract.algorithm,
        run=policy.contract.run,
        collisions=sum(drive.failed for drive in drives),
        laps=sum(laps) / len(laps) if laps else None,
        mean_speed_mps=sum(m.driven_lane_m for m in metrics) / time_s / scale,
    )


def wilson_low(successes: int, episodes: int, z: float = 1.96) -> float:
    """Lower end of the interval of Wilson 1927 for a share (z = 1.96: 95 %)."""
    share, n = successes / episodes, episodes
    centre = share + z * z / (2 * n)
    spread = z * math.sqrt(share * (1 - share) / n + z * z / (4 * n * n))
    return max(0.0, (centre - spread) / (1 + z * z / n))


def _drive(
    policy: DrivingPolicy,
    world: BatchWorld,
    wanted: np.ndarray,
    zero: str | None,
    tracer: Tracer | None,
) -> Iterator[tuple[tuple[int, int], Drive]]:
    """The wanted (robots, rounds) episodes, as each ends: robot and round, and how it went."""
    observation = world.reset()
    names = world.task.fact_names
    rounds, missing = np.zeros(world.n_robots, dtype=int), wanted.copy()
    while missing.any():
        if tracer is not None:
            tracer.see(observation)
        step = world.step(_choose(policy, observation, zero))
        if tracer is not None:
            tracer.end(step)
        observation = step.observation
        for robot, metrics in zip(step.finished.robots, step.finished.metrics, strict=True):
            episode = (int(robot), int(rounds[robot]))
            if episode[1] < wanted.shape[1] and missing[episode]:
                missing[episode] = False
                facts = dict(zip(names, step.task.facts[:, robot].tolist(), strict=True))
                success, failed = step.task.success[robot], step.task.terminated[robot]
                laps = facts.get("laps")
                yield episode, Drive(0, bool(success), metrics, bool(failed), laps)
            rounds[robot] += 1


def _choose(policy: DrivingPolicy, observation: Observation, zero: str | None) -> np.ndarray:
    stack, image = observation.image, policy.contract.image
    frames = [stack[..., k : k + 3] for k in range(0, stack.shape[-1], 3)]
    pictures = np.concatenate([preprocess_batch(frame, image) for frame in frames], axis=-1)
    path = observation.path
    if zero == "image":
        pictures = np.zeros_like(pictures)
    elif zero == "path":
        if path is None:
            raise ConfigError("zero: expected image, got path; this task gives none")
        path = np.zeros_like(path)
    return policy.act(pictures, path)
