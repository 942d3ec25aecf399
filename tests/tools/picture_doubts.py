"""How often the robot doubts the pictures of honest simulated drives: every doubt is a false one.

python -m tests.tools.picture_doubts --model robot/models/nav_ppo.onnx --look reality --missions 200
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from robot.camera.source import Frame
from robot.command_line import OneLineParser, answer, whole
from robot.contract import ACTION_WHEELS, CONTROL_DT_S
from robot.geometry import STILL, Pose
from robot.inference.preprocess import preprocess_batch
from robot.lens import DUCKIEBOT_LENS, CameraRig
from robot.navigation.road_map import load_map
from robot.navigation.road_paint import road_paint
from robot.safety.gates import SafetyLimits
from robot.vision.plausibility import PictureDoubts
from robot.vision.road_fit import RoadFit
from sim_pybullet.batch import BatchWorld
from sim_pybullet.randomise import load_look_sampler
from sim_pybullet.tasks.spec import find_task
from tools.loop.drive import expect_navigator
from trainer.judging.evaluate import open_policy

ROBOTS = 20
WORLD_MISSIONS = 100  # until new worlds are painted
ARMING = 5  # pictures that a robot has seen when it arms
LIMITS = SafetyLimits()


@dataclass
class Eyes:
    """One robot's eyes during one mission."""

    doubts: PictureDoubts
    turn: int = 0
    sequence: int = 0
    last: np.ndarray | None = None
    reason: str = ""  # the first doubt

    def look(self, image: np.ndarray, pose: Pose, action: int | None) -> None:
        """Take a picture and note the first doubt."""
        self.sequence += self.last is None or not np.array_equal(image, self.last)
        self.last, now_s = image.copy(), CONTROL_DT_S * self.turn
        wheels = STILL if action is None else ACTION_WHEELS[action]
        sight = self.doubts.look(Frame(image, self.sequence, now_s), pose, wheels, now_s)
        self.turn += 1
        if not self.reason and self.turn > ARMING:
            blind, still = sight.blind_s > LIMITS.blind_s, sight.still_s > LIMITS.still_s
            self.reason = "blind" if blind else "still" if still else sight.wrong


def missions(options: argparse.Namespace) -> Iterator[Eyes]:
    """The eyes of each mission, as it ends; for ever."""
    expect_navigator(options.model)
    policy = open_policy(options.model)
    task = find_task(policy.contract.task)
    maps = [load_map(name) for name in options.map]
    # Of the mounting that the look draws the robot knows nothing.
    roads = [RoadFit(CameraRig(DUCKIEBOT_LENS), road_paint(road_map)) for road_map in maps]
    look = load_look_sampler(options.look, "arena")
    seed = options.seed
    while True:
        world = BatchWorld(task.build(maps, ROBOTS), look, seed=seed, pool_size=3)
        yield from _drive(world, policy, roads)
        seed += 1


def _drive(world: BatchWorld, policy: Any, roads: list[RoadFit]) -> Iterator[Eyes]:
    observation, ended = world.reset(), 0
    eyes = [Eyes(PictureDoubts(roads[world.maps[robot]])) for robot in range(ROBOTS)]
    actions: list[int | None] = [None] * ROBOTS
    while ended < WORLD_MISSIONS:
        for robot, believed in enumerate(world.guidance.poses.tolist()):
            eyes[robot].look(observation.image[robot], Pose(*believed), actions[robot])
        images = preprocess_batch(observation.image, policy.contract.image)
        chosen = policy.values(images, observation.path).argmax(axis=1)
        step = world.step(chosen)
        observation, actions = step.observation, [int(action) for action in chosen]
        for robot in step.finished.robots.tolist():
            yield eyes[robot]
            eyes[robot] = Eyes(PictureDoubts(roads[world.maps[robot]]))
            actions[robot] = None
            ended += 1
    world.close()


def measure(options: argparse.Namespace) -> None:
    """Count over so many missions."""
    cv2.setNumThreads(1)
    decisions, reasons = 0, []
    for number, eyes in enumerate(missions(options), start=1):
        decisions += eyes.turn
        reasons += [eyes.reason] * bool(eyes.reason)
        if number % 10 == 0 or number == options.missions:
            print(f"{number} missions, {decisions} decisions, doubted: {reasons}", flush=True)
        if number == options.missions:
            break


def main(arguments: list[str] | None = None) -> int:
    """Exit status 0, or 2 for wrong input."""
    parser = OneLineParser(prog="python -m tests.tools.picture_doubts", description=__doc__)
    parser.add_argument("--model", type=Path, required=True, help="ONNX policy that drives")
    parser.add_argument("--map", nargs="+", default=["arena", "town"])
    parser.add_argument("--look", default="randomised")
    parser.add_argument("--missions", type=whole(1, 100_000), default=40)
    parser.add_argument("--seed", type=whole(0, 2**31 - 1), default=1)
    options = parser.parse_args(arguments)
    return answer("picture_doubts", lambda: measure(options))


if __name__ == "__main__":
    sys.exit(main())
