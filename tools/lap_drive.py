"""Laps through virtual hardware: the robot's runtime, lock-step, on one simulated robot."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from robot.contract import CONTROL_DT_S
from robot.geometry import Pose, wrap_angle
from robot.hat.config import HatConfig
from robot.hat.driver import MotorDriver
from robot.hat.stepper_hat import StepperHat
from robot.navigation.path import Path as LanePath
from robot.navigation.path import lane_loop
from robot.navigation.road_map import RoadMap
from robot.parts import Policy, Tick
from robot.runtime.loop import Runtime
from robot.safety.state_machine import Command, Safety
from robot.vision.plausibility import PictureDoubts
from sim_pybullet.look import Look
from sim_pybullet.tasks.following import HALF_LANE_TILES
from sim_pybullet.virtual.clock import VirtualClock
from sim_pybullet.virtual.hat import VirtualHat
from sim_pybullet.virtual.i2c import VirtualI2cBus
from sim_pybullet.virtual.world import VirtualWorld

DAWDLE_MPS = 0.1  # a drive slower than this on average is given up
ARMING_S = 0.3  # a person looks before they arm


@dataclass
class LapRecord:
    """What happened on the way; distances [m], angles [rad]."""

    laps: float = 0.0
    seconds: float = 0.0
    left_lane: bool = False
    collided: bool = False
    state: str = ""
    reason: str = ""
    lost_steps: tuple[int, int] = (0, 0)
    offsets_m: list[float] = field(default_factory=list)
    odometry_errors: list[tuple[float, float]] = field(default_factory=list)  # [m], [rad]


Watcher = Callable[[Tick, Pose, LapRecord], None]


class LapDrive:
    """One robot on the outer lane of a loop map, from disarmed to the last lap."""

    def __init__(self, road_map: RoadMap, look: Look, policy: Policy, seed: int) -> None:
        rng = np.random.default_rng(seed)
        self.clock = VirtualClock()
        self.hat = VirtualHat(bus := VirtualI2cBus(), self.clock)
        config = HatConfig()
        self.driver = MotorDriver(StepperHat(bus, config, self.clock), config, self.clock)
        self.world = VirtualWorld(road_map, look, self.hat, self.clock, rng)
        self.lane: LanePath = lane_loop(road_map)
        self.half_lane_m = HALF_LANE_TILES * road_map.tile_size_m
        self.runtime = Runtime(
            *(self.world, policy, self.driver, Safety(self.clock.now), self.clock),
            eyes=PictureDoubts(),
        )
        start = Pose(*self.lane.pose_at(rng.uniform(0.0, self.lane.length_m)))
        self.world.place(start)
        self.driver.pose = start

    def drive(self, laps: float, watch: Watcher) -> LapRecord:
        """Arm, drive ``laps`` laps or until something stops the robot, and disarm."""
        record = LapRecord()
        limit_s = laps * self.lane.length_m / DAWDLE_MPS
        with self.driver:
            while self.clock.now() < ARMING_S:
                self._turn(record, watch)
            for command in (Command.ARM, Command.AUTO):
                self.runtime.ask(command)
            while record.laps < laps and self.clock.now() < limit_s:
                verdict = self._turn(record, watch).verdict
                record.state, record.reason = verdict.state.value, verdict.sentence
                if not verdict.may_move or record.left_lane or record.collided:
                    break
            record.lost_steps = self.hat.lost_steps
            self.runtime.ask(Command.DISARM)
        record.seconds = self.clock.now()
        return record

    def close(self) -> None:
        """Free the world."""
        self.world.close()

    def _turn(self, record: LapRecord, watch: Watcher) -> Tick:
        before = self.lane.project(*self.world.pose[:2])
        tick = self.runtime.step()
        self.world.advance(self.driver, self.clock.now() + CONTROL_DT_S)
        pose = self.world.pose
        at, length_m = self.lane.project(*pose[:2]), self.lane.length_m
        record.laps += math.remainder(at.arc_m - before.arc_m, length_m) / length_m
        record.offsets_m.append(at.offset_m)
        record.left_lane = abs(at.offset_m) > self.half_lane_m
        record.collided = self.world.collided
        believed = self.driver.pose
        turned_rad = float(wrap_angle(believed.heading_rad - pose.heading_rad))
        record.odometry_errors.append((math.dist(believed[:2], pose[:2]), turned_rad))
        watch(tick, pose, record)
        return tick
