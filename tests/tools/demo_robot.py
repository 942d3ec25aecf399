"""A robot, blind but exact, and its localizer on real links: the page cannot tell.

The loop, its rules, missions and reports are the robot's own. By itself:
``python -m tests.tools.demo_robot --keys keys --map town``. It ends with who started it.
"""

from __future__ import annotations

import argparse
import contextlib
import math
import os
import time
from pathlib import Path

import numpy as np

from robot.camera.source import Frame
from robot.computer.clock import MonotonicClock
from robot.computer.health import Health
from robot.contract import (
    ACTION_TWISTS,
    CONTROL_DT_S,
    DRIVE,
    PATH_ANGLE_LIMIT_RAD,
    PATH_POINTS,
    ImageSpec,
    PolicyContract,
)
from robot.errors import ContractError
from robot.geometry import STILL, Pose, WheelSpeeds
from robot.inference.preprocess import FRAME_SHAPE
from robot.link.command_server import CommandServer
from robot.link.messages import PosesMessage, Sighting, Telemetry
from robot.link.sockets import LinkConfig, Publisher
from robot.navigation.navigator import MissionNavigator
from robot.navigation.path import FIRST_POINT_M, POINT_SPACING_M
from robot.navigation.road_map import RoadMap, load_map
from robot.runtime.loop import Runtime
from robot.runtime.remote import RemoteOperator
from robot.runtime.reports import Reporter
from robot.runtime.timing import RateKeeper
from robot.safety.gates import SafetyLimits
from robot.safety.state_machine import Safety, State
from tests.robot.link.conftest import configs_of

NAME = "duck"
POSE_NOISE_M = 0.004
# A process on a busy desktop stalls now and then; a robot's own loop may not.
LIMITS = SafetyLimits(loop_age_s=2.0, frame_age_s=2.0)


LONGEST_S = 0.2  # of one move: a process that stalled must not leap
POINT = 2  # of the path input: 14 cm ahead
POINT_M = FIRST_POINT_M + POINT * POINT_SPACING_M
CURVATURES = np.array([twist.turn_radps / twist.forward_mps for twist in ACTION_TWISTS])


class PurePursuit:
    """A ``Policy`` that steers for a point ahead on its path (Coulter 1992), and never looks."""

    contract = PolicyContract("navigation", "pursuit", ImageSpec(), PATH_POINTS)

    def values(self, images: np.ndarray, path: np.ndarray | None = None) -> np.ndarray:
        """(N, actions), for paths (N, PATH_POINTS)."""
        assert path is not None  # the contract asks for one
        wanted = 2.0 * PATH_ANGLE_LIMIT_RAD * path[:, POINT] / POINT_M
        return np.asarray(-np.abs(CURVATURES - wanted[:, None]))


class StraightOn:
    """A ``Policy`` that keeps a straight lane, and knows no path."""

    contract = PolicyContract("lane", "straight on", ImageSpec())

    def values(self, images: np.ndarray, path: np.ndarray | None = None) -> np.ndarray:
        """(N, actions)."""
        assert path is None
        return np.repeat(-np.abs(CURVATURES)[None], len(images), axis=0)


class ExactMotors:
    """``Motors`` whose ``pose`` is where the robot is."""

    def __init__(self, pose: Pose) -> None:
        self._pose, self._wheels, self._at_s = pose, STILL, time.monotonic()

    @property
    def pose(self) -> Pose:
        """Now."""
        before_s, self._at_s = self._at_s, time.monotonic()
        dt_s = min(self._at_s - before_s, LONGEST_S)
        twist = DRIVE.twist(self._wheels)
        self._pose = self._pose.moved(twist.forward_mps * dt_s, twist.turn_radps * dt_s)
        return self._pose

    def set_wheels(self, wheels: WheelSpeeds) -> None:
        """At once."""
        self._pose, self._wheels = self.pose, wheels

    def stop(self) -> None:
        """At once."""
        self.set_wheels(STILL)

    def release(self) -> None:
        """As ``stop``."""
        self.stop()

    def mend(self) -> None:
        """Nothing breaks."""


class BlindCamera:
    """Blotches, which nobody is shown."""

    def __init__(self) -> None:
        self._rng, self._sequence = np.random.default_rng(0), 0

    def read(self) -> Frame:
        self._sequence += 1
        picture = self._rng.integers(0, 256, FRAME_SHAPE, dtype=np.uint8)
        return Frame(picture, self._sequence, time.monotonic())


def on_straight_lane(road_map: RoadMap, share: float) -> Pose:
    """The pose after a share of the longest straight lane; ContractError on a map without one."""
    longest, found = 0.0, None
    for lane in road_map.lanes:
        points = np.asarray(lane.control_points_m)
        (x_m, y_m), ways = points[3] - points[0], np.diff(points, axis=0)
        straight = np.abs(x_m * ways[:, 1] - y_m * ways[:, 0]).max() < 1e-9
        if straight and math.hypot(x_m, y_m) > longest:
            longest, at = math.hypot(x_m, y_m), points[0] + share * (points[3] - points[0])
            found = Pose(float(at[0]), float(at[1]), math.atan2(y_m, x_m))
    if found is None:
        raise ContractError(f"{road_map.name}: expected a map with a straight road, got none")
    return found


class DemoRobot:
    """Call ``turn`` ten times a second, from one thread. It may be one that keeps its lane."""

    def __init__(
        self, road_map: RoadMap, configs: dict[str, LinkConfig], keeps_lane: bool = False
    ) -> None:
        self._motors = ExactMotors(on_straight_lane(road_map, 1.0 / 3.0))
        self._rng = np.random.default_rng(0)
        self._links = [configs[name].open() for name in ("robot", "localizer")]
        link = self._links[0]
        self._poses: Publisher[PosesMessage] = Publisher(self._links[1], PosesMessage)
        self._seen: PosesMessage | None = None
        clock = MonotonicClock()
        navigator = None
        if not keeps_lane:
            told = (lambda: self._seen), lambda: self._motors.pose
            navigator = MissionNavigator(road_map, *told, NAME)
        about = Telemetry(NAME, State.DISARMED.value, model="demonstration", map=road_map.name)
        reporter = Reporter(
            Publisher(link, Telemetry).send,
            None,
            *(about, LIMITS, navigator, Health(time.monotonic, ()).readings),
        )
        self.safety = Safety(clock.now, LIMITS)
        self.runtime = Runtime(
            *(BlindCamera(), StraightOn() if keeps_lane else PurePursuit()),
            *(self._motors, self.safety, clock),
            subscribers=(reporter,) if navigator is None else (navigator, reporter),
            operators=(RemoteOperator(CommandServer(link), navigator),),
            navigator=navigator,
        )

    @property
    def pose(self) -> Pose:
        """Where it truly is."""
        return self._motors.pose

    def turn(self, lag_s: float = 0.0) -> None:
        """Tell a pose, as the localizer does, and turn the loop."""
        x_m, y_m, heading_rad = self.pose
        right_m, up_m = self._rng.normal(0.0, POSE_NOISE_M, 2).tolist()
        seen = Sighting(NAME, x_m + right_m, y_m + up_m, heading_rad, 0.98)
        self._seen = self._poses.send(PosesMessage((seen,), time.monotonic()))
        self.runtime.step(lag_s)

    def close(self) -> None:
        """Fall silent."""
        for link in self._links:
            link.close()


def main(argv: list[str] | None = None) -> int:
    """Run until interrupted, or until whoever started it is gone, however it went."""
    parser = argparse.ArgumentParser(description="A demonstration robot on loopback links.")
    parser.add_argument("--base-port", type=int, default=LinkConfig.base_port)
    parser.add_argument("--keys", type=Path, required=True, help="as keygen made them")
    parser.add_argument("--map", default="town")
    parser.add_argument("--keeps-lane", action="store_true", help="has no navigator")
    parser.add_argument("--parent", type=int, default=os.getppid(), help="ends with this process")
    arguments = parser.parse_args(argv)
    folders = {name: arguments.keys / name for name in ("robot", "localizer")}
    configs = configs_of(folders, arguments.base_port)
    robot = DemoRobot(load_map(arguments.map), configs, arguments.keeps_lane)
    rate = RateKeeper(CONTROL_DT_S, MonotonicClock())
    with contextlib.closing(robot), contextlib.suppress(KeyboardInterrupt):
        while os.getppid() == arguments.parent:
            robot.turn(rate.wait())
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
