"""The operator behind the link, as the runtime knows one."""

import math
from typing import Optional, Tuple

from robot.errors import ContractError, PlanError
from robot.geometry import STILL, Pose, WheelSpeeds
from robot.link import messages
from robot.link.command_server import CommandServer
from robot.navigation.navigator import MissionNavigator
from robot.parts import Ask
from robot.safety.state_machine import Command

START_WITHIN_M = 0.15  # a robot's length: as well as a person puts it down


class RemoteOperator:
    """The link's commands, as an ``Operator``; a robot that keeps its lane has no navigator."""

    def __init__(self, server: CommandServer, navigator: Optional[MissionNavigator]) -> None:
        self._server = server
        self._navigator = navigator

    def serve(self, ask: Ask) -> None:
        """Hand over what has come; what is refused is answered with the reason."""
        self._server.serve(lambda command: self._obey(command, ask))

    def age_s(self) -> Optional[float]:
        """Time since the operator's last sign of life [s]; infinite before the first."""
        return self._server.operator_age_s()

    def _obey(self, command: messages.Command, ask: Ask) -> None:
        wheels: Optional[WheelSpeeds] = None
        mission = command.mission
        if mission is not None:
            navigator = self._navigates
            if command.kind == "place" and mission.start is not None:
                (x_m, y_m), (to_x_m, to_y_m) = mission.start, mission.destination
                navigator.put(Pose(x_m, y_m, math.atan2(to_y_m - y_m, to_x_m - x_m)))
                return
            navigator.plan(mission.destination)
            self._expect_at_start(mission.start)
            if command.kind == "plan":
                return
            navigator.begin(command.id, mission.destination)
        elif command.kind == "auto" and not (self._navigator is None or self._navigator.searches):
            raise ContractError(
                "auto: expected a mission, as this robot drives to destinations; without one it "
                "drives only while it looks for its place by sight"
            )
        if command.kind == "manual":
            wheels = WheelSpeeds(*(command.wheels or STILL))
        kind = "auto" if command.kind == "mission" else command.kind
        answer = ask(Command(kind), wheels)
        if not answer.accepted:
            if mission is not None:
                self._navigates.end("failed", answer.sentence)
            raise ContractError(answer.sentence)

    def _expect_at_start(self, start_m: Optional[Tuple[float, float]]) -> None:
        pose = self._navigates.pose
        if start_m is None or pose is None:
            return
        away_m = math.dist(start_m, pose[:2])
        if away_m > START_WITHIN_M:
            raise PlanError(
                f"expected the robot within {100.0 * START_WITHIN_M:.0f} cm of the mission's start "
                f"({start_m[0]:.2f}, {start_m[1]:.2f}) m, it is {away_m:.2f} m from there; put it "
                "there, or choose a destination alone"
            )

    @property
    def _navigates(self) -> MissionNavigator:
        if self._navigator is None:
            raise ContractError(
                "expected a robot that navigates, got one with a lane policy, which knows no "
                "destination; arm it, then let it keep its lane"
            )
        return self._navigator
