"""``python -m tests.tools.find_place [--click] [--missions K] [--look L] [--map M] [--starts N]``

Robots without a localizer: the robot's own runtime over virtual hardware, in lock-step, in one
process. Put down anywhere on a lane and told nothing, or with ``--click`` roughly where (10 cm and
20 degrees), each drives on until it knows its place; then it is sent on missions, one after the
other, never put back. Each start is a map, a place and a draw of the look of its own.
"""

from __future__ import annotations

import argparse
import math
from dataclasses import dataclass

import numpy as np

from robot.contract import CONTROL_DT_S
from robot.errors import PlanError
from robot.geometry import Pose, wrap_angle
from robot.hat.config import HatConfig
from robot.hat.driver import MotorDriver
from robot.hat.stepper_hat import StepperHat
from robot.inference.policy import SHIPPED_MODELS, open_policy
from robot.navigation.navigator import MissionNavigator
from robot.navigation.road_map import RoadMap, load_map
from robot.parts import Tick
from robot.runtime.loop import Runtime
from robot.safety.state_machine import Command, Safety, State
from robot.vision.plausibility import PictureDoubts
from robot.vision.sight import Glimpse, OnnxSight
from sim_pybullet.look import Look
from sim_pybullet.randomise import load_looks
from sim_pybullet.virtual.clock import VirtualClock
from sim_pybullet.virtual.hat import VirtualHat
from sim_pybullet.virtual.i2c import VirtualI2cBus
from sim_pybullet.virtual.world import VirtualWorld

ARMING_S = 1.0
LONGEST_S = 120.0
RIGHT_M, RIGHT_RAD = 0.15, 0.35
SHORTEST_M = 1.0  # of a mission


@dataclass
class Found:
    """What became of one start; places are judged when the robot first says that it knows one."""

    right: bool | None = None  # None: none was found
    off_m: float = math.nan
    junctions: int = 0
    driven_m: float = 0.0
    sure: bool = False  # it knows place and wheels, and holds
    end: str = ""
    strayed: bool = False  # off the road
    arrived: int = 0  # missions in a row

    def __str__(self) -> str:
        told = {None: "none found", True: "right", False: "WRONG"}[self.right]
        strayed = ", off the road" if self.strayed else ""
        return (
            f"{told}, {100 * self.off_m:.0f} cm off, {self.junctions} junctions; sure after "
            f"{self.driven_m:.1f} m: {self.sure}; arrived {self.arrived}; {self.end}{strayed}"
        )


class Lonely:
    """One robot with sight and a map, without a localizer."""

    def __init__(self, road_map: RoadMap, look: Look, model: str, seed: int) -> None:
        self.rng, self.road_map = np.random.default_rng(seed), road_map
        self.clock = VirtualClock()
        hat = VirtualHat(bus := VirtualI2cBus(), self.clock)
        config = HatConfig()
        self.driver = MotorDriver(StepperHat(bus, config, self.clock), config, self.clock)
        self.world = VirtualWorld(road_map, look, hat, self.clock, self.rng)
        self.world.place(self.anywhere())
        glimpse = Glimpse(OnnxSight(SHIPPED_MODELS / "sight.onnx"), self.world.read)
        odometry = lambda: self.driver.pose  # noqa: E731
        self.navigator = MissionNavigator(road_map, lambda: None, odometry, "robot", glimpse)
        self.runtime = Runtime(
            *(self.world, open_policy(model), self.driver, Safety(self.clock.now), self.clock),
            subscribers=(self.navigator,),
            navigator=self.navigator,
            eyes=PictureDoubts(),
        )

    def anywhere(self) -> Pose:
        """On a lane, not in a junction."""
        lanes = [e for e in self.road_map.lanes if not e.tile.is_junction]
        return lanes[int(self.rng.integers(len(lanes)))].pose_at(float(self.rng.uniform(0.1, 0.9)))

    def turn(self) -> Tick:
        """One decision."""
        tick = self.runtime.step()
        self.world.advance(self.driver, self.clock.now() + CONTROL_DT_S)
        return tick

    def wait(self) -> None:
        """A person looks."""
        until_s = self.clock.now() + ARMING_S
        while self.clock.now() < until_s:
            self.turn()

    def depart(self) -> bool:
        """Arm and drive."""
        self.runtime.ask(Command.ARM)
        return self.runtime.ask(Command.AUTO).accepted

    @property
    def strayed(self) -> bool:
        """Off the road."""
        return not self.road_map.on_road(*self.world.pose[:2])

    def click(self) -> None:
        """Tell it roughly where it is."""
        beside = self.rng.uniform(-1.0, 1.0, 3) * (0.07, 0.07, 0.35)
        told = Pose(*(np.array(self.world.pose) + beside).tolist())
        if self.road_map.on_road(told.x_m, told.y_m):
            self.navigator.put(told)


def find(robot: Lonely, click: bool) -> Found:
    """Until it knows its place and wheels, or stands in vain."""
    found = Found()
    robot.wait()
    if click:
        robot.click()
    departed, began_s, crosses = False, robot.clock.now(), False
    while robot.clock.now() - began_s < LONGEST_S and not robot.strayed:
        before = robot.world.pose
        tick, navigator = robot.turn(), robot.navigator
        found.driven_m += math.dist(before[:2], robot.world.pose[:2])
        tile, crossed = robot.road_map.tile_at(*robot.world.pose[:2]), crosses
        crosses = tile is not None and tile.is_junction
        found.junctions += found.right is None and crossed and not crosses
        if navigator.pose is not None and found.right is None:
            truth = robot.world.pose
            found.off_m = math.dist(navigator.pose[:2], truth[:2])
            turned = abs(float(wrap_angle(navigator.pose.heading_rad - truth.heading_rad)))
            found.right = found.off_m < RIGHT_M and turned < RIGHT_RAD
        if departed and tick.verdict.state is not State.AUTO:
            break
        departed = departed or (navigator.searches and robot.depart())
    found.strayed = robot.strayed
    found.sure = found.right is not None and not robot.navigator.searches
    found.end = robot.runtime.safety.verdict.sentence
    return found


def mission(robot: Lonely) -> str:
    """One from where the robot is to anywhere; what went wrong."""
    navigator = robot.navigator
    while True:
        goal = robot.anywhere()
        try:
            if navigator.plan((goal.x_m, goal.y_m)).length_m > SHORTEST_M:
                break
        except PlanError as error:
            if "expected the robot in a lane" in str(error):
                return str(error)
    robot.wait()
    navigator.begin("mission", (goal.x_m, goal.y_m))
    if not robot.depart():
        return f"refused: {robot.runtime.safety.verdict.sentence}"
    began_s = robot.clock.now()
    while robot.turn().verdict.state is State.AUTO and robot.clock.now() - began_s < LONGEST_S:
        if robot.strayed:
            return "off the road"
    assert navigator.status is not None
    missed_m = math.dist(robot.world.pose[:2], (goal.x_m, goal.y_m))
    if navigator.status.phase == "arrived":
        return "" if missed_m < RIGHT_M else f"arrived {100 * missed_m:.0f} cm off"
    return f"{navigator.status.phase}: {navigator.status.reason}"


def drive(robot: Lonely, click: bool, missions: int) -> Found:
    """All of it."""
    with robot.driver:
        found = find(robot, click)
        while found.sure and found.arrived < missions:
            wrong = mission(robot)
            if wrong:
                found.end = wrong
                break
            found.arrived += 1
        robot.runtime.ask(Command.DISARM)
    robot.world.close()
    return found


def main() -> None:
    """Print each start and the sum."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--model", default=str(SHIPPED_MODELS / "nav_ppo.onnx"))
    parser.add_argument("--look", default="reality")
    parser.add_argument("--map", nargs="+", default=["town", "arena"])
    parser.add_argument("--starts", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--missions", type=int, default=0)
    parser.add_argument("--click", action="store_true")
    options = parser.parse_args()
    maps = [load_map(name) for name in options.map]
    looks = load_looks(options.look)
    every = []
    for seed in range(options.seed, options.seed + options.starts):
        look = looks(np.random.default_rng((seed, 1))) if callable(looks) else looks[0]
        robot = Lonely(maps[seed % len(maps)], look, options.model, seed)
        every.append(drive(robot, options.click, options.missions))
        print(f"{seed} {robot.road_map.name}: {every[-1]}", flush=True)
    early = [each for each in every if each.right is not None and each.junctions <= 3]
    print(
        f"of {len(every)}: {len(early)} found a place after at most three junctions, "
        f"{sum(bool(e.right) for e in early)} right; {sum(e.sure for e in every)} sure of place "
        f"and wheels; {sum(e.arrived for e in every)} missions arrived, "
        f"{sum(e.arrived == options.missions for e in every)} robots on all {options.missions}; "
        f"{sum(e.strayed for e in every)} off the road"
    )


if __name__ == "__main__":
    main()
