"""A robot, its camera and its localizer, simulated, on real links: the page cannot tell.

The wheels obey exactly and every input is in time, so what can be tried is the page itself and the
rules of ``robot.safety.state_machine``. Run by ``python -m tools.monitor --demo``, or by itself:
``python -m tools.monitor.demo_robot --base-port 5570 --map town``.
"""

from __future__ import annotations

import argparse
import math
import os
import shutil
import time

import numpy as np

from robot.contract import ACTION_TWISTS, CONTROL_DT_S
from robot.errors import ContractError
from robot.link.commands import Command
from robot.link.config import LinkConfig
from robot.link.messages import FrameMessage, PosesMessage, Sighting
from robot.link.sockets import Publisher
from robot.link.telemetry import (
    InputAge,
    Reading,
    Telemetry,
)
from robot.navigation.planner import LaneGraph, plan_path
from robot.navigation.road_map import RoadMap, load_map
from robot.runtime.remote import expect_at_start
from robot.safety.state_machine import Command as Request
from robot.safety.state_machine import Inputs, Safety, SafetyLimits, State
from tools.monitor.demo_camera import Camera, make_camera
from tools.monitor.demo_drive import Drive, start_pose

NAME = "duck"
TURN_S = 0.05
POSE_NOISE_M = 0.004
# A process on a busy desktop stalls now and then; a robot's own loop may not.
LIMITS = SafetyLimits(loop_age_s=2.0, frame_age_s=2.0)


class DemoRobot:
    """Call ``turn`` every ``TURN_S``; not for several threads."""

    def __init__(
        self, road_map: RoadMap, config: LinkConfig, camera: Camera | None, rng: np.random.Generator
    ) -> None:
        self.pose = start_pose(road_map)
        self.safety = Safety(time.monotonic, LIMITS)
        self._road_map = road_map
        self._graph = LaneGraph(road_map)
        self._camera = camera
        self._rng = rng
        self._link = config.open()
        self._telemetry: Publisher[Telemetry] = config.publisher(self._link, Telemetry)
        self._frames: Publisher[FrameMessage] = config.publisher(self._link, FrameMessage)
        self._poses: Publisher[PosesMessage] = config.publisher(self._link, PosesMessage)
        self._commands = config.command_server(self._link)
        self._drive = Drive()
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
            self._drive.ended("stopped", verdict.sentence)
        if now_s - self._decided_s >= CONTROL_DT_S - TURN_S / 2:
            self._decided_s = now_s
            self._decide()
            self._publish(now_s)
        if self._drive.action is not None and self.safety.verdict.may_move:
            twist = ACTION_TWISTS[self._drive.action]
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
            self._drive = Drive(command.id, planned, command.mission.destination)
        elif self.safety.verdict.state is not State.AUTO:
            self._drive.ended("stopped", self.safety.verdict.sentence)

    def _inputs(self, now_s: float) -> Inputs:
        return Inputs(
            frame_age_s=now_s - self._framed_s,
            pose_age_s=now_s - self._turned_s,
            link_age_s=self._commands.operator_age_s(),
            manual_age_s=now_s - self._manual[1] if math.isfinite(self._manual[1]) else None,
        )

    def _decide(self) -> None:
        state = self.safety.verdict.state
        self._drive.action = None
        if state is State.MANUAL:
            self._drive.action = self._manual[0]
        if state is State.AUTO and self._drive.follow(self.pose):
            self.safety.arrived()
            self._drive.ended("arrived", "")

    def _publish(self, now_s: float) -> None:
        if self._camera is not None:
            self._frames.send(self._camera.frame(self.pose))
        self._framed_s = time.monotonic()
        self._telemetry.send(self._report(self._framed_s - now_s))

    def _report(self, lag_s: float) -> Telemetry:
        drive, verdict = self._drive, self.safety.verdict
        inputs = self._inputs(time.monotonic())
        attention = None
        if drive.target_m is not None and self._camera is not None:
            attention = self._camera.attention(self.pose, drive.target_m)
        link_s = inputs.link_age_s if inputs.link_age_s != math.inf else None
        return Telemetry(
            NAME,
            verdict.state.value,
            verdict.sentence,
            action=drive.action,
            values=drive.values,
            pose=(self.pose.x_m, self.pose.y_m, self.pose.heading_rad),
            path=drive.points,
            mission=drive.status,
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
        heading_rad = self.pose.heading_rad
        seen = Sighting(NAME, float(x_m), float(y_m), heading_rad, 0.98)
        self._poses.send(PosesMessage((seen,), now_s))


def _health() -> tuple[Reading, ...]:
    """Of the machine that runs the demonstration."""
    disk = shutil.disk_usage("/")
    free = 100.0 * disk.free / disk.total
    return (
        Reading("load", os.getloadavg()[0]),
        Reading("disk free", round(free), "%", "ok" if free > 5.0 else "warn"),
    )


def main(argv: list[str] | None = None) -> int:
    """Run until interrupted."""
    parser = argparse.ArgumentParser(description="A demonstration robot on plain loopback links.")
    parser.add_argument("--base-port", type=int, default=LinkConfig.base_port)
    parser.add_argument("--map", default="town")
    parser.add_argument("--no-camera", action="store_true")
    arguments = parser.parse_args(argv)
    road_map = load_map(arguments.map)
    config = LinkConfig(plaintext=True, base_port=arguments.base_port)
    camera = None if arguments.no_camera else make_camera(road_map)
    robot = DemoRobot(road_map, config, camera, np.random.default_rng(0))
    try:
        while True:
            began_s = time.monotonic()
            robot.turn()
            time.sleep(max(0.0, TURN_S - (time.monotonic() - began_s)))
    except KeyboardInterrupt:
        return 0
    finally:
        robot.close()


if __name__ == "__main__":
    raise SystemExit(main())
