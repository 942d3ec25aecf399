"""A robot, its camera and its localizer, simulated, on real links: the page cannot tell.

The wheels obey exactly and every input is in time, so what can be tried is the page itself and the
rules of ``robot.safety.state_machine``. Run by ``python -m tools.monitor --demo``, or by itself:
``python -m tools.monitor.demo_robot --base-port 5570 --map town``. It ends with who started it.
"""

from __future__ import annotations

import argparse
import contextlib
import math
import os
import shutil
import time
from dataclasses import replace

import numpy as np

from robot.contract import ACTION_TWISTS, CONTROL_DT_S
from robot.errors import ContractError
from robot.geometry import Pose
from robot.link.commands import Command
from robot.link.config import LinkConfig
from robot.link.messages import FrameMessage, PosesMessage, Sighting
from robot.link.sockets import Publisher
from robot.link.telemetry import InputAge, MissionStatus, Reading, Telemetry, thin_path
from robot.navigation.path import Path
from robot.navigation.planner import LaneGraph, plan_path
from robot.navigation.road_map import RoadMap, load_map
from robot.runtime.remote import expect_at_start
from robot.safety.state_machine import Command as Request
from robot.safety.state_machine import Inputs, Safety, SafetyLimits, State
from tools.lane_places import on_straight_lane
from tools.monitor.demo_camera import DemoCamera

NAME = "duck"
TURN_S = 0.05
POSE_NOISE_M = 0.004
LOOK_AHEAD_M = 0.16
ARRIVED_M = 0.03
CURVATURES = np.array([twist.turn_radps / twist.forward_mps for twist in ACTION_TWISTS])
# A process on a busy desktop stalls now and then; a robot's own loop may not.
LIMITS = SafetyLimits(loop_age_s=2.0, frame_age_s=2.0)


def start_pose(road_map: RoadMap) -> Pose:
    """A third into the map's first straight lane."""
    return on_straight_lane(road_map, 1.0 / 3.0)


class DemoRobot:
    """Call ``turn`` every ``TURN_S``; not for several threads."""

    def __init__(
        self,
        road_map: RoadMap,
        config: LinkConfig,
        camera: DemoCamera | None,
        rng: np.random.Generator,
    ) -> None:
        self.pose = start_pose(road_map)
        self.safety = Safety(time.monotonic, LIMITS)
        self._road_map, self._camera, self._rng = road_map, camera, rng
        self._graph = LaneGraph(road_map)
        self._link = config.open()
        self._telemetry: Publisher[Telemetry] = config.publisher(self._link, Telemetry)
        self._frames: Publisher[FrameMessage] = config.publisher(self._link, FrameMessage)
        self._poses: Publisher[PosesMessage] = config.publisher(self._link, PosesMessage)
        self._commands = config.command_server(self._link)
        self._path: Path | None = None
        self._mission: MissionStatus | None = None
        self._hint: int | None = None  # where on the path it was
        self._action: int | None = None
        self._values: tuple[float, ...] = ()
        self._target_m: np.ndarray | None = None
        self._manual: tuple[int | None, float] = (None, -math.inf)
        self._turned_s = self._decided_s = self._framed_s = time.monotonic()

    def turn(self) -> None:
        """Serve commands, look at the gates, move, publish."""
        now_s = time.monotonic()
        dt_s, self._turned_s = now_s - self._turned_s, now_s
        self._commands.serve(self._obey)
        before = self.safety.verdict
        verdict = self.safety.check(self._inputs(time.monotonic()))
        if before.state is State.AUTO and verdict.state is not State.AUTO:
            self._ended("stopped", verdict.sentence)
        if now_s - self._decided_s >= CONTROL_DT_S - TURN_S / 2:
            self._decided_s = now_s
            self._decide()
            self._publish(now_s)
        if self._action is not None and self.safety.verdict.may_move:
            twist = ACTION_TWISTS[self._action]
            step_s = min(dt_s, 2 * TURN_S)
            self.pose = self.pose.moved(twist.forward_mps * step_s, twist.turn_radps * step_s)
        self._publish_pose(now_s)

    def close(self) -> None:
        """Fall silent."""
        self._link.close()

    def _obey(self, command: Command) -> None:
        planned = None
        if command.mission is not None:
            planned = plan_path(self._graph, self.pose, command.mission.destination)
            expect_at_start(self.pose, command.mission.start)
            if command.kind == "plan":
                return
        if command.kind == "manual":
            self._manual = (command.action, time.monotonic())
        request = "auto" if command.kind == "mission" else command.kind
        answer = self.safety.command(Request(request))
        if not answer.accepted:
            raise ContractError(answer.sentence)
        if planned is not None and command.mission is not None:
            self._path, self._hint = planned, None
            place, length_m = command.mission.destination, planned.length_m
            self._mission = MissionStatus(command.id, place, remaining_m=length_m)
        elif self.safety.verdict.state is not State.AUTO:
            self._ended("stopped", self.safety.verdict.sentence)

    def _ended(self, phase: str, reason: str) -> None:
        """The mission, if there is one, is over."""
        self._action, self._values, self._target_m, self._path = None, (), None, None
        if self._mission is not None and self._mission.phase == "driving":
            progress = 1.0 if phase == "arrived" else self._mission.progress
            self._mission = replace(self._mission, phase=phase, progress=progress, reason=reason)

    def _inputs(self, now_s: float) -> Inputs:
        return Inputs(
            frame_age_s=now_s - self._framed_s,
            pose_age_s=now_s - self._turned_s,
            link_age_s=self._commands.operator_age_s(),
            manual_age_s=now_s - self._manual[1] if math.isfinite(self._manual[1]) else None,
        )

    def _decide(self) -> None:
        state = self.safety.verdict.state
        self._action = self._manual[0] if state is State.MANUAL else None
        if state is State.AUTO and self._path is not None:
            self._follow(self._path)

    def _follow(self, path: Path) -> None:
        """Steer for a point ahead on the path, by pure pursuit (Coulter 1992)."""
        assert self._mission is not None
        place = path.project(self.pose.x_m, self.pose.y_m, self._hint)
        self._hint = place.index
        left_m = max(0.0, path.length_m - place.arc_m)
        progress = min(1.0, place.arc_m / path.length_m)
        self._mission = replace(
            self._mission, progress=progress, remaining_m=left_m, offset_m=place.offset_m
        )
        if left_m < ARRIVED_M:
            self.safety.arrived()
            self._ended("arrived", "")
            return
        self._target_m = np.array(path.pose_at(place.arc_m + LOOK_AHEAD_M)[:2])
        forward_m, side_m = self.pose.to_robot(self._target_m)
        wanted = 2.0 * side_m / max(forward_m**2 + side_m**2, 1e-6)
        self._values = tuple(float(value) for value in -np.abs(CURVATURES - wanted))
        self._action = int(np.argmax(self._values))

    def _publish(self, now_s: float) -> None:
        if self._camera is not None:
            self._frames.send(self._camera.frame(self.pose))
        self._framed_s = time.monotonic()
        self._telemetry.send(self._report(self._framed_s - now_s))

    def _report(self, lag_s: float) -> Telemetry:
        verdict, inputs = self.safety.verdict, self._inputs(time.monotonic())
        attention = None
        if self._target_m is not None and self._camera is not None:
            attention = self._camera.attention(self.pose, self._target_m)
        link_s = inputs.link_age_s if inputs.link_age_s != math.inf else None
        return Telemetry(
            NAME,
            verdict.state.value,
            verdict.sentence,
            action=self._action,
            values=self._values,
            pose=(self.pose.x_m, self.pose.y_m, self.pose.heading_rad),
            path=thin_path(self._path.points_m) if self._path else (),
            mission=self._mission,
            inputs=(
                InputAge("camera", inputs.frame_age_s, SafetyLimits.frame_age_s),
                InputAge("pose", inputs.pose_age_s, SafetyLimits.pose_age_s),
                InputAge("operator", link_s, SafetyLimits.link_age_s),
            ),
            health=_health(),
            fps=1.0 / CONTROL_DT_S,
            lag_s=lag_s,
            model="demonstration",
            map=self._road_map.name,
            attention=attention,
        )

    def _publish_pose(self, now_s: float) -> None:
        x_m, y_m = self.pose[:2] + self._rng.normal(0.0, POSE_NOISE_M, 2)
        seen = Sighting(NAME, float(x_m), float(y_m), self.pose.heading_rad, 0.98)
        self._poses.send(PosesMessage((seen,), now_s))


def _health() -> tuple[Reading, ...]:
    """Of the machine that runs the demonstration."""
    disk = shutil.disk_usage("/")
    free = 100.0 * disk.free / disk.total
    level = "ok" if free > 5.0 else "warn"
    return Reading("load", os.getloadavg()[0]), Reading("disk free", round(free), "%", level)


def main(argv: list[str] | None = None) -> int:
    """Run until interrupted, or until whoever started it is gone, however it went."""
    parser = argparse.ArgumentParser(description="A demonstration robot on plain loopback links.")
    parser.add_argument("--base-port", type=int, default=LinkConfig.base_port)
    parser.add_argument("--map", default="town")
    parser.add_argument("--no-camera", action="store_true")
    parser.add_argument("--parent", type=int, default=os.getppid(), help="ends with this process")
    arguments = parser.parse_args(argv)
    road_map, camera = load_map(arguments.map), None
    with contextlib.suppress(ImportError):
        camera = None if arguments.no_camera else DemoCamera(road_map)
    config = LinkConfig(plaintext=True, base_port=arguments.base_port)
    robot = DemoRobot(road_map, config, camera, np.random.default_rng(0))
    with contextlib.closing(robot), contextlib.suppress(KeyboardInterrupt):
        while os.getppid() == arguments.parent:
            began_s = time.monotonic()
            robot.turn()
            time.sleep(max(0.0, TURN_S - (time.monotonic() - began_s)))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
