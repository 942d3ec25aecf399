"""How often the robot doubts pictures of simulated drives, honest ones or spoiled ones.

    python -m tools.picture_doubts --model robot/models/nav_ppo.onnx --look reality --missions 200
    python -m tools.picture_doubts --model ... --look randomised --spoil mirrored --spoil noise

The policy drives by the honest pictures; the eyes of the robot see them spoiled from one second
after the beginning of each mission, and know the pose that the robot believes in.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from robot.camera.source import Frame
from robot.contract import ACTION_WHEELS, CONTROL_DT_S
from robot.errors import DuckpilotError, nearest
from robot.geometry import Pose
from robot.inference.preprocess import preprocess_batch
from robot.lens import DUCKIEBOT_LENS, CameraRig
from robot.navigation.road_map import RoadMap, load_map
from robot.navigation.road_paint import road_paint
from robot.output import write_json
from robot.parts import Sight
from robot.safety.gates import SafetyLimits
from robot.safety.wheel_limits import STILL
from robot.vision.plausibility import PictureDoubts
from robot.vision.road_fit import LaneFit, MapFit, RoadFit
from sim_pybullet.batch import BatchWorld
from sim_pybullet.randomise import load_look_sampler
from sim_pybullet.tasks.spec import find_task
from tools.faults.spoil import SPOILED, Spoil
from trainer.judging.evaluate import open_policy

ROBOTS = 20
POOL = 3  # painted worlds per map
WORLD_MISSIONS = 100  # until new worlds are painted
SPOILED_FROM_S = 1.0
BUDGET_S = 0.25  # after the threshold
LIMITS = SafetyLimits()


@dataclass
class Eyes:
    """One robot's eyes during one mission."""

    doubts: PictureDoubts
    spoil: Spoil | None
    turn: int = 0
    sequence: int = 0
    last: np.ndarray | None = None
    reason: str = ""  # the first doubt
    doubted_s: float = float("nan")  # since the pictures were spoiled, or since the beginning

    def look(self, image: np.ndarray, pose: Pose, action: int | None) -> None:
        """Take a picture and note the first doubt."""
        self.sequence += self.last is None or not np.array_equal(image, self.last)
        self.last, now_s = image.copy(), CONTROL_DT_S * self.turn
        spoils = self.spoil is not None and now_s >= SPOILED_FROM_S
        seen = self.spoil(image) if spoils and self.spoil is not None else image
        wheels = STILL if action is None else ACTION_WHEELS[action]
        sight = self.doubts.look(Frame(seen, self.sequence, now_s), pose, wheels, now_s)
        self.turn += 1
        if not self.reason and self.turn > 5:  # a robot that arms has seen some pictures
            self.reason = doubt(sight)
            self.doubted_s = now_s - (SPOILED_FROM_S if self.spoil else 0.0)


@dataclass
class Tally:
    """Missions and what was doubted in them."""

    missions: int = 0
    decisions: int = 0
    doubted: list[tuple[str, float]] = field(default_factory=list)
    in_time: int = 0


def doubt(sight: Sight) -> str:
    """Which gate this trips, "" for none."""
    if sight.blind_s > LIMITS.blind_s:
        return "blind"
    if sight.still_s > LIMITS.still_s:
        return "still"
    return sight.wrong


def missions(options: argparse.Namespace, spoil: str) -> Iterator[Eyes]:
    """The eyes of each mission, as it ends; for ever."""
    policy = open_policy(options.model)
    task = find_task(policy.contract.task)
    maps = [load_map(name) for name in options.map]
    roads = [road_of(road_map, bool(task.path_points)) for road_map in maps]
    look = load_look_sampler(options.look, "arena" if task.path_points else None)
    seed = options.seed
    while True:
        world = BatchWorld(task.build(maps, ROBOTS), look, seed=seed, pool_size=POOL)
        yield from _drive(world, policy, roads, spoil)
        seed += 1


def road_of(road_map: RoadMap, guided: bool) -> RoadFit:
    """What the robot knows of the road: nothing of the mounting that the look has drawn."""
    rig = CameraRig(DUCKIEBOT_LENS)
    return MapFit(road_paint(road_map), rig) if guided else LaneFit(rig)


def _drive(world: BatchWorld, policy: Any, roads: list[RoadFit], spoil: str) -> Iterator[Eyes]:
    def fresh(robot: int) -> Eyes:
        make = SPOILED[spoil].make if spoil else None
        return Eyes(PictureDoubts(roads[world.maps[robot]]), make() if make else None)

    observation = world.reset()
    eyes, ended = [fresh(robot) for robot in range(ROBOTS)], 0
    actions: list[int | None] = [None] * ROBOTS
    while ended < WORLD_MISSIONS:
        poses = world.believed_poses
        for robot in range(ROBOTS):
            pose = Pose(*(float(value) for value in poses[robot]))
            eyes[robot].look(observation.image[robot], pose, actions[robot])
        chosen = policy.act(
            preprocess_batch(observation.image, policy.contract.image), observation.path
        )
        step = world.step(chosen)
        observation, actions = step.observation, [int(action) for action in chosen]
        for robot in step.finished.robots.tolist():
            yield eyes[robot]
            eyes[robot], actions[robot] = fresh(robot), None
            ended += 1
    world.close()


def measure(options: argparse.Namespace, spoil: str) -> Tally:
    """Count over so many missions."""
    tally = Tally()
    threshold_s = SPOILED[spoil].threshold_s if spoil else 0.0
    for eyes in missions(options, spoil):
        if spoil and CONTROL_DT_S * eyes.turn < SPOILED_FROM_S + threshold_s + BUDGET_S:
            continue  # over before the robot had to doubt
        tally.missions += 1
        tally.decisions += eyes.turn
        if eyes.reason:
            tally.doubted.append((eyes.reason, eyes.doubted_s))
            tally.in_time += 0.0 <= eyes.doubted_s <= threshold_s + BUDGET_S
        if tally.missions % 10 == 0:
            print(f"  {tally.missions} missions, {len(tally.doubted)} doubted", file=sys.stderr)
        if tally.missions >= options.missions:
            return tally
    return tally


def parse(arguments: list[str] | None) -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(prog="python -m tools.picture_doubts", description=__doc__)
    parser.add_argument("--model", type=Path, required=True, help="ONNX policy that drives")
    parser.add_argument("--map", nargs="+", default=["arena", "town"])
    parser.add_argument("--look", default="randomised")
    parser.add_argument("--missions", type=int, default=40, help="for each kind of pictures")
    parser.add_argument("--spoil", action="append", default=[], help=", ".join(SPOILED))
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", type=Path, help="write the figures")
    options = parser.parse_args(arguments)
    if options.missions < 1:
        parser.error(f"--missions: expected 1 or more, got {options.missions}")
    return options


def main(arguments: list[str] | None = None) -> int:
    """Exit status 0, or 2 for wrong input."""
    options = parse(arguments)
    cv2.setNumThreads(1)
    figures: dict[str, Any] = {}
    try:
        for spoil in options.spoil:
            if spoil not in SPOILED:
                raise DuckpilotError(f"--spoil: unknown {spoil!r}; {nearest(spoil, SPOILED)}")
        for spoil in options.spoil or [""]:
            tally = measure(options, spoil)
            figures[spoil or "honest"] = vars(tally)
            told = f"{tally.in_time} doubted in time, " if spoil else ""
            print(
                f"{spoil or 'honest'}: {tally.missions} missions, {tally.decisions} decisions, "
                f"{told}{len(tally.doubted)} doubted: {tally.doubted if not spoil else ''}",
                flush=True,
            )
        if options.json:
            write_json(options.json, {"schema": 1, "figures": figures})
    except DuckpilotError as error:
        print(f"picture_doubts: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
