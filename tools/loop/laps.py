"""The runtime drives laps through virtual hardware, in lock-step, in one process.

Town, motors, camera and time are virtual; from the frame to the bytes on the bus it is the robot.
"""

import math
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from rich.progress import Progress, TextColumn

from robot.contract import CONTROL_DT_S
from robot.geometry import Pose, wrap_angle
from robot.hat.config import HatConfig
from robot.hat.driver import MotorDriver
from robot.hat.stepper_hat import StepperHat
from robot.inference.policy import open_policy
from robot.navigation.path import Path as LanePath
from robot.navigation.path import lane_loop
from robot.navigation.road_map import RoadMap, load_map
from robot.output import expect_writable, write_json
from robot.parts import Policy, Tick
from robot.runtime.loop import Runtime
from robot.safety.state_machine import MOVING, Command, Safety
from robot.vision.plausibility import PictureDoubts
from sim_pybullet.look import Look
from sim_pybullet.tasks.following import HALF_LANE_TILES
from sim_pybullet.virtual.clock import VirtualClock
from sim_pybullet.virtual.hat import VirtualHat
from sim_pybullet.virtual.i2c import VirtualI2cBus
from sim_pybullet.virtual.world import VirtualWorld
from tools.loop.cli import LoopOptions
from tools.loop.sites import sites_of
from tools.video import DriveFilm, Moment

OF_LAPS = "{task.completed:.2f}/{task.total:.2f} laps"
DAWDLE_MPS = 0.1  # a drive slower than this on average is given up
ARMING_S = 0.3  # a person looks before they arm


@dataclass
class LapRecord:
    """What happened on the way; distances [m], angles [rad]."""

    laps: float = 0.0
    seconds: float = 0.0
    left_lane: bool = False
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
        self.driver.pose = self.lane.pose_at(rng.uniform(0.0, self.lane.length_m))
        self.world.place(self.driver.pose)

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
                if verdict.state not in MOVING or record.left_lane or self.world.collided:
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
        believed = self.driver.pose
        turned_rad = float(wrap_angle(believed.heading_rad - pose.heading_rad))
        record.odometry_errors.append((math.dist(believed[:2], pose[:2]), turned_rad))
        watch(tick, pose, record)
        return tick


def tell(options: LoopOptions) -> int:
    """Drive as asked and say how it went; 0 when all laps were driven, 1 otherwise."""
    inputs = [options.policy, Path(options.translator) if options.translator else None]
    expect_writable(options.json, options.video, inputs=inputs)
    laps = options.laps or 0.0
    site = sites_of(options.look, options.seed)(0)
    policy = open_policy(options.policy, options.translator)
    lap_drive = LapDrive(load_map(options.road), site.look, policy, options.seed)
    with ExitStack() as stack:
        stack.callback(lap_drive.close)
        bar = stack.enter_context(Progress(*Progress.get_default_columns(), TextColumn(OF_LAPS)))
        task = bar.add_task("drive", total=laps)
        film = None
        if options.video:
            film = DriveFilm(options.video, options.policy, CONTROL_DT_S)
            film.turn_to(lap_drive.world.scene.ground)
            stack.callback(film.close)

        ring_m = lap_drive.lane.points_m[[*range(len(lap_drive.lane.points_m)), 0]].tolist()

        def watch(tick: Tick, pose: Pose, record: LapRecord) -> None:
            bar.update(task, completed=min(record.laps, laps))
            if film is not None and tick.frame is not None:
                state, reason = tick.verdict.state.value, tick.verdict.sentence
                values = [] if tick.values is None else tick.values.tolist()
                told = (ring_m, values, tick.action, f"lap {record.laps:.2f}")
                film.add(Moment(tick.frame.image, pose, None, state, reason, *told))

        record = lap_drive.drive(laps, watch)
    figures = summary(record, options, site.name)
    if options.json:
        write_json(options.json, figures)
    print(
        f"{record.laps:.2f} of {laps:g} laps in {record.seconds:.0f} s, "
        f"{100 * figures['mean_path_distance_m']:.1f} cm from the lane's middle on average, "
        f"{record.state}: {record.reason}"
    )
    return 0 if figures["arrived"] else 1


def summary(record: LapRecord, options: LoopOptions, site: str) -> dict[str, Any]:
    """The JSON of a drive."""
    rms = np.sqrt(np.mean(np.square(record.odometry_errors), axis=0))
    offsets_m = np.abs(record.offsets_m)
    arrived = record.laps >= (options.laps or 0.0)
    stop = {"fault": record.reason, "latency_s": None, "state": record.state}
    inputs = {name: getattr(options, name) for name in ("look", "laps", "seed")}
    inputs |= {"map": options.road, "model": str(options.policy)}
    return {
        "schema": 1,
        "inputs": {**inputs, "translator": options.translator or ""},
        "site": site,
        "missions": 1,
        "arrived": int(arrived),
        "mean_path_distance_m": float(offsets_m.mean()),
        "max_path_distance_m": float(offsets_m.max()),
        "position_rms_m": float(rms[0]),  # of the step odometry, which nothing corrects here
        "heading_rms_rad": float(rms[1]),
        "lost_steps": list(record.lost_steps),
        "stops": [] if arrived else [stop],
        **{name: getattr(record, name) for name in ("laps", "seconds", "state", "reason")},
    }
