"""A virtual robot driven by a virtual person, and recorded as a real one is."""

from __future__ import annotations

import json
import math
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np

from robot.contract import CONTROL_DT_S, DRIVE, MAX_WHEEL_MPS, ImageSpec
from robot.errors import MapError
from robot.geometry import Pose, Twist, wrap_angle
from robot.link.messages import PoseMessage
from robot.navigation.road_map import RoadMap, load_map
from robot.recording import topics
from robot.recording.drive_file import DriveFile, png
from robot.recording.topics import Turn
from sim_pybullet.batch import BatchWorld
from sim_pybullet.look import ARENA_POSE, Look
from sim_pybullet.motors import pursuit
from sim_pybullet.sensing.guidance_feed import PoseError
from sim_pybullet.tasks.lane_keeping import LaneKeeping
from sim_pybullet.tasks.navigation import Navigation
from sim_pybullet.tasks.spec import Task, TaskStep
from tools.loop.drive import whim

BEGAN_S = 1_000.0  # by the robot's clock
_ENDLESS_LAPS = 1e6


def record_drive(
    look: Look,
    map_name: str,
    seconds: float,
    seed: int,
    path: Path,
    reverse: float = 0.0,
    mapped: bool = True,
) -> Path:
    """Drive along a lane of a ring of road, else from place to place, and record it.

    The person sees where the robot is; the recording's overhead poses have the arena's errors.
    In a town the robot's own belief is recorded too.

    Args:
        look: of the robot and the floor.
        map_name: of a ring, or of a town.
        seconds: of driving.
        seed: of everything random.
        path: of the recording, .mcap.
        reverse: share of the time that the steering is written down the wrong way round.
        mapped: whether the recording tells the map and where on it the robot was.
    """
    task = _endless(load_map(map_name))
    world = BatchWorld(task, [replace(look, pose=ARENA_POSE)], ImageSpec(), seed)
    rng, told = np.random.default_rng((seed, 1)), PoseError(1)
    told.reset(0, ARENA_POSE, rng)
    config = json.dumps({"hat": {"acceleration_mps2": look.drive.acceleration_mps2}})
    file = DriveFile(path, {"map": map_name * mapped, "robot": "virtual", "config": config})
    image, person, frame = world.reset().image, Person(rng), 1
    for k in range(round(seconds / CONTROL_DT_S)):
        now_s = BEGAN_S + k * CONTROL_DT_S
        wheels = person.wheels(world, k * CONTROL_DT_S)
        told_wheels = wheels[::-1] if k % 40 < 40 * reverse else wheels
        arrived, captured_s = told.observe(world.poses, now_s, rng)
        age_s = now_s - float(captured_s[0])
        pose = arrived[0] if mapped else np.full(3, np.nan)
        _write(file, (k, frame), now_s, image[0], told_wheels, pose, age_s)
        if task.guided and mapped:
            believed = Pose(*world.guidance.poses[0].tolist())
            file.add(topics.POSE, now_s, topics.pose_message(now_s, believed), k)
        shares = np.clip(np.array([wheels]) / MAX_WHEEL_MPS, -1.0, 1.0)
        before, image = image, world.step(shares).observation.image
        frame += not np.array_equal(before, image)
    file.close()
    world.close()
    return path


def _endless(road_map: RoadMap) -> Task:
    with suppress(MapError):
        return LaneKeeping([road_map], 1, "both", _ENDLESS_LAPS)
    return Errands([road_map], 1)


class Errands(Navigation):
    """One mission after the other, without end."""

    def step(self, poses: np.ndarray, collided: np.ndarray) -> TaskStep:
        """As of `Navigation`; who arrives, or is lost, goes on from there."""
        judged = super().step(poses, collided)
        for i in np.flatnonzero(judged.truncated | judged.terminated):
            pose = Pose(*poses[i].tolist())
            path = self._path_from(pose, np.random.default_rng(int(self._steps[i])))
            at = path.project(pose.x_m, pose.y_m)
            turned_rad = float(wrap_angle(pose.heading_rad - at.heading_rad))
            self._start(int(i), path, 0, at.arc_m, at.offset_m, turned_rad)
        never = np.zeros(self.n_robots, dtype=bool)
        return judged._replace(terminated=never, truncated=never, success=never)


class Person:
    """Follows the lane briskly: brakes, stops and drives off, weaves and corrects by jerks."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._phases = rng.uniform(0.0, 2.0 * math.pi, 4)

    def wheels(self, world: BatchWorld, time_s: float) -> tuple[float, float]:
        """Rim speeds [m/s] of the only robot."""
        pace, weave = whim(time_s, self._phases)
        speed_mps = 0.3 * pace
        task, poses = world.task, world.poses
        bend_pm = float(pursuit(task.paths, poses, task.course.arc_m + 0.16)[0])
        turn = speed_mps * (np.clip(bend_pm, -9.0, 9.0) + weave)
        left, right = DRIVE.wheels(Twist(speed_mps, turn))
        most = max(1.0, abs(left) / MAX_WHEEL_MPS, abs(right) / MAX_WHEEL_MPS)
        return left / most, right / most


def _write(
    file: DriveFile,
    numbers: tuple[int, int],
    now_s: float,
    image: np.ndarray,
    wheels: tuple[float, float],
    pose: np.ndarray,
    age_s: float,
) -> None:
    seen, (k, frame) = not np.isnan(pose[0]), numbers
    turn = Turn(
        *(k, now_s, 0.01, 0.0, "MANUAL", "", "", wheels),
        frame=frame,
        frame_time_s=now_s,
        pose_age_s=age_s if seen else None,
    )
    file.add(topics.CAMERA, now_s, topics.image_message(now_s, png(image), "png"), frame)
    file.add(topics.TURN, now_s, turn.plain(), k)
    if seen:
        x_m, y_m, heading_rad = Pose(*pose.tolist())
        message = PoseMessage("virtual", x_m, y_m, heading_rad, 1.0, now_s)
        file.add(topics.OVERHEAD, now_s, topics.overhead_message(now_s, message), k)
