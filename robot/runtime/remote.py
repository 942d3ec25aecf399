"""The operator behind the link, as the runtime knows one."""

from __future__ import annotations

from typing import Callable, Optional, Protocol

from robot.contract import ACTION_WHEELS
from robot.errors import ContractError
from robot.geometry import WheelSpeeds
from robot.link import commands
from robot.navigation.navigator import MissionNavigator
from robot.parts import Ask
from robot.safety.state_machine import Command
from robot.safety.wheel_limits import STILL


class Server(Protocol):
    """What is needed of a `robot.link.command_server.CommandServer`."""

    def serve(self, handle: Callable[[commands.Command], None]) -> None:
        """Give each new command to ``handle``, which raises DuckpilotError to refuse it."""

    def operator_age_s(self) -> float:
        """Age of the operator's last sign of life [s]."""


class RemoteOperator:
    """Serves the commands of the link; keeps ``robot.parts.Operator``.

    Args:
        server: the robot's end of the link.
        navigator: plans missions; None for a robot that keeps its lane.
    """

    def __init__(self, server: Server, navigator: Optional[MissionNavigator]) -> None:
        self._server = server
        self._navigator = navigator

    def serve(self, ask: Ask) -> None:
        """Hand over what has come; what is refused is answered with the reason."""
        self._server.serve(lambda command: self._obey(command, ask))

    def age_s(self) -> Optional[float]:
        """Time since the operator's last sign of life [s]; infinite before the first."""
        return self._server.operator_age_s()

    def _obey(self, command: commands.Command, ask: Ask) -> None:
        wheels: Optional[WheelSpeeds] = None
        if command.mission is not None:
            self._navigates.begin(command.id, command.mission.destination)
        if command.kind == "manual":
            wheels = STILL if command.action is None else ACTION_WHEELS[command.action]
        kind = "auto" if command.kind == "mission" else command.kind
        answer = ask(Command(kind), wheels)
        if not answer.accepted:
            if command.mission is not None:
                self._navigates.end("failed", answer.sentence)
            raise ContractError(answer.sentence)

    @property
    def _navigates(self) -> MissionNavigator:
        if self._navigator is None:
            raise ContractError(
                "expected a robot that navigates, got one with a lane policy, which knows no "
                "destination; start it at its own terminal"
            )
        return self._navigator
