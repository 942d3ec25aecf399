"""Where the three machines are; the sockets of each program. ``keys`` tells the streams."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Type

from robot.errors import ConfigError
from robot.link.command_client import CommandClient
from robot.link.command_server import CommandServer
from robot.link.commands import Command
from robot.link.keys import BOUND_BY, load_keys
from robot.link.sockets import Link, M, Publisher, Subscriber


@dataclass(frozen=True)
class LinkConfig:
    """The links of one program, as its YAML file says them."""

    keys: str = ""  # this machine's folder of ``robot keygen``
    plaintext: bool = False  # without keys; on this machine only
    robot_host: str = "127.0.0.1"
    localizer_host: str = "127.0.0.1"
    base_port: int = 5570

    def __post_init__(self) -> None:
        if not 1024 <= self.base_port <= 65535 - len(BOUND_BY):
            raise ConfigError(f"base_port: expected 1024 to 65531, got {self.base_port}")

    def open(self) -> Link:
        """The link of this program; ConfigError unless exactly one of keys and plaintext is set."""
        return Link(load_keys(self.keys) if self.keys else None, self.plaintext)

    def bind_endpoint(self, stream: str) -> str:
        """Where the machine that publishes a stream binds it."""
        return f"tcp://{'127.0.0.1' if self.plaintext else '*'}:{self._port(stream)}"

    def connect_endpoint(self, stream: str) -> str:
        """Where the others find it."""
        host = self.robot_host if BOUND_BY[stream] == "robot" else self.localizer_host
        return f"tcp://{host}:{self._port(stream)}"

    def publisher(self, link: Link, kind: Type[M]) -> Publisher[M]:
        """Publishes messages of a class."""
        return Publisher(link, self.bind_endpoint(kind.KIND), kind)

    def subscriber(self, link: Link, kind: Type[M]) -> Subscriber[M]:
        """Receives the newest message of a class."""
        return Subscriber(link, self.connect_endpoint(kind.KIND), kind)

    def command_server(self, link: Link) -> CommandServer:
        """The robot's ear."""
        return CommandServer(link, self.bind_endpoint(Command.KIND))

    def command_client(self, link: Link) -> CommandClient:
        """The operator's hand."""
        return CommandClient(link, self.connect_endpoint(Command.KIND))

    def _port(self, stream: str) -> int:
        return self.base_port + list(BOUND_BY).index(stream)
