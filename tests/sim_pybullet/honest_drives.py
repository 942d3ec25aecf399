"""Missions without pictures, in which nothing is wrong: every doubt about them is a false one.

The expert drives by what the robots believe, with wheels and overhead poses of the look.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from robot.contract import ACTION_WHEELS, CONTROL_DT_S
from robot.geometry import Pose, compose
from robot.navigation.fusion import PoseFusion
from robot.navigation.road_map import load_map
from robot.navigation.way_check import WayCheck
from sim_pybullet.motors import (
    PHYSICS_DT_S,
    PHYSICS_STEPS,
    MotorModel,
    expert_actions,
)
from sim_pybullet.randomise import load_look_sampler
from sim_pybullet.sensing.guidance_feed import PoseError
from sim_pybullet.tasks.navigation import Navigation

STAND_S = 1.5  # before the missions begin
LONGEST_S = 40.0


class Turn(NamedTuple):
    """What N robots have after a decision."""

    time_s: float
    odometry: np.ndarray  # (N, 3) by steps
    overhead: tuple[np.ndarray, np.ndarray]  # poses (N, 3) and capture times (N,) [s]
    driving: np.ndarray  # (N,) bool
    at_bound: np.ndarray  # (N,) bool


@dataclass(frozen=True)
class Doubts:
    """Of honest missions. A doubt is greater than 1."""

    missions: int
    driven_s: float
    doubted: int
    coarse_p99: float
    coarse_max: float
    fine_max: float
    at_bound: int  # missions in which wheels seemed to be off by more than wheels can be


def blind_drives(look: str, count: int, maps: tuple[str, ...], seed: int) -> Iterator[Turn]:
    """``count`` robots stand, then drive a mission each; ends when all have, or gave up."""
    rng = np.random.default_rng(seed)
    task = Navigation([load_map(name) for name in maps], count)
    poses = task.reset(np.arange(count), rng)
    errors, fusion, motors = PoseError(count), PoseFusion(count), MotorModel(count)
    sample = load_look_sampler(look, "arena")
    for robot in range(count):
        drawn = sample(rng)
        motors.reset(robot, drawn.drive)
        errors.reset(robot, drawn.pose, rng)
    odometry, done = np.zeros((count, 3)), np.zeros(count, dtype=bool)
    hints = task.paths.index_at(task.course.arc_m)
    for tick in range(1, round((STAND_S + LONGEST_S) / CONTROL_DT_S)):
        now_s = tick * CONTROL_DT_S
        driving = ~done & (now_s > STAND_S)
        believed = np.where(np.isfinite(fusion.poses), fusion.poses, poses)
        at = task.paths.project(believed[:, :2], hints)
        hints = at.index
        wheels = (
            np.array(ACTION_WHEELS)[expert_actions(task.paths, believed, at.arc_m)]
            * driving[:, None]
        )
        stepped = np.zeros((count, 2))
        for _ in range(PHYSICS_STEPS):
            poses = compose(poses, _arc(motors.step(wheels, rng) * PHYSICS_DT_S))
            counted = motors.counted * PHYSICS_DT_S
            odometry = compose(odometry, _arc(counted))
            stepped += counted
        fusion.move(stepped[:, 0], stepped[:, 1], now_s)
        overhead = errors.observe(poses, now_s, rng)
        fusion.measure(*overhead)
        yield Turn(now_s, odometry, overhead, driving, fusion.at_bound)
        if driving.any():
            judged = task.step(poses, np.zeros(count, dtype=bool))
            done |= driving & (judged.terminated | judged.truncated)
        if done.all():
            return


def _arc(driven: np.ndarray) -> np.ndarray:
    """Steps (N, 3) of ways [m] and turns [rad] (N, 2), small ones."""
    way, half = driven[:, 0], 0.5 * driven[:, 1]
    return np.stack((way * np.cos(half), way * np.sin(half), driven[:, 1]), axis=1)


def doubts(look: str, count: int, maps: tuple[str, ...], seed: int) -> Doubts:
    """Drive honestly, and count who is doubted."""
    checks = [WayCheck() for _ in range(count)]
    worst = np.zeros((count, 2))
    bound, before, driven = np.zeros(count, dtype=bool), np.zeros(count, dtype=bool), 0
    begun = before.copy()  # who arrived halts, and may be sent on
    for turn in blind_drives(look, count, maps, seed):
        for begins in np.flatnonzero(turn.driving & ~before):
            checks[begins].reset()
        before, begun = turn.driving, begun | turn.driving
        for robot, check in enumerate(checks):
            check.stepped(turn.time_s, Pose(*turn.odometry[robot]))
            seen = turn.overhead[0][robot]
            if np.isfinite(seen[0]):
                check.see(float(turn.overhead[1][robot]), Pose(*seen))
            if begun[robot]:
                worst[robot] = np.maximum(worst[robot], check.doubt[:2])
        bound |= turn.at_bound & turn.driving
        driven += int(turn.driving.sum())
    return Doubts(
        missions=count,
        driven_s=driven * CONTROL_DT_S,
        doubted=int((worst > 1.0).any(axis=1).sum()),
        coarse_p99=float(np.percentile(worst[:, 0], 99.0)),
        coarse_max=float(worst[:, 0].max()),
        fine_max=float(worst[:, 1].max()),
        at_bound=int(bound.sum()),
    )
