"""A robot, its camera and its localizer, simulated, on real links: the page cannot tell.

The loop, its rules, missions and reports are the robot's own, its policy a shipped one; blind, it
steers for a point ahead. Run by
``python -m tools.monitor --demo``, or by itself:
``python -m tools.monitor.demo_robot --base-port 5570 --map town``. It ends with who started it.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import time

import numpy as np

from robot.computer.clock import MonotonicClock
from robot.computer.health import Health
from robot.contract import CONTROL_DT_S
from robot.geometry import Pose
from robot.inference.policy import SHIPPED_MODELS, OnnxPolicy
from robot.link.config import LinkConfig
from robot.link.messages import FrameMessage, PosesMessage, Sighting
from robot.link.sockets import Publisher
from robot.link.telemetry import Telemetry
from robot.navigation.navigator import MissionNavigator
from robot.navigation.road_map import RoadMap, load_map
from robot.parts import Policy
from robot.runtime.loop import Runtime
from robot.runtime.remote import RemoteOperator
from robot.runtime.reports import Reporter
from robot.runtime.timing import RateKeeper
from robot.safety.gates import SafetyLimits
from robot.safety.state_machine import Safety, State
from tools.lane_places import on_straight_lane
from tools.monitor.__main__ import DEMO_MODEL
from tools.monitor.demo_parts import DemoCamera, ExactMotors, PurePursuit

NAME = "duck"
POSE_NOISE_M = 0.004
# A process on a busy desktop stalls now and then; a robot's own loop may not.
LIMITS = SafetyLimits(loop_age_s=2.0, frame_age_s=2.0)


class DemoRobot:
    """Call ``turn`` ten times a second, from one thread."""

    def __init__(self, road_map: RoadMap, config: LinkConfig, sees: bool = True) -> None:
        self._motors = ExactMotors(on_straight_lane(road_map, 1.0 / 3.0))
        self._rng = np.random.default_rng(0)
        self._link = config.open()
        self._poses: Publisher[PosesMessage] = config.publisher(self._link, PosesMessage)
        self._seen: PosesMessage | None = None
        camera, clock = DemoCamera(road_map, self._motors, sees), MonotonicClock()
        navigator = MissionNavigator(road_map, lambda: self._seen, lambda: self._motors.pose, NAME)
        about = Telemetry(NAME, State.DISARMED.value, model="demonstration", map=road_map.name)
        reporter = Reporter(
            config.publisher(self._link, Telemetry).send,
            config.publisher(self._link, FrameMessage).send if camera.sees else None,
            *(about, LIMITS, navigator, Health(time.monotonic).readings),
        )
        self.safety = Safety(clock.now, LIMITS)
        policy: Policy = OnnxPolicy(SHIPPED_MODELS / DEMO_MODEL) if camera.sees else PurePursuit()
        self.runtime = Runtime(
            *(camera, policy, self._motors, self.safety, clock),
            subscribers=(navigator, reporter),
            operators=(RemoteOperator(config.command_server(self._link), navigator),),
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
        self._link.close()


def main(argv: list[str] | None = None) -> int:
    """Run until interrupted, or until whoever started it is gone, however it went."""
    parser = argparse.ArgumentParser(description="A demonstration robot on plain loopback links.")
    parser.add_argument("--base-port", type=int, default=LinkConfig.base_port)
    parser.add_argument("--map", default="town")
    parser.add_argument("--no-camera", action="store_true")
    parser.add_argument("--parent", type=int, default=os.getppid(), help="ends with this process")
    arguments = parser.parse_args(argv)
    config = LinkConfig(plaintext=True, base_port=arguments.base_port)
    robot = DemoRobot(load_map(arguments.map), config, not arguments.no_camera)
    rate = RateKeeper(CONTROL_DT_S, MonotonicClock())
    with contextlib.closing(robot), contextlib.suppress(KeyboardInterrupt):
        while os.getppid() == arguments.parent:
            robot.turn(rate.wait())
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
