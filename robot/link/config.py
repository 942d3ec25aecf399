"""Where the three machines are, and this one's keys. ``keys`` tells the streams."""

from __future__ import annotations

from dataclasses import dataclass

from robot.errors import ConfigError
from robot.link.keys import BOUND_BY, load_keys
from robot.link.sockets import Link


@dataclass(frozen=True)
class LinkConfig:
    """The links of one program, as its YAML file says them."""

    keys: str  # this machine's folder of ``robot keygen``
    robot_host: str = "127.0.0.1"
    localizer_host: str = "127.0.0.1"
    base_port: int = 5570

    def __post_init__(self) -> None:
        if not 1024 <= self.base_port <= 65535 - len(BOUND_BY):
            raise ConfigError(f"base_port: expected 1024 to 65531, got {self.base_port}")

    def open(self) -> Link:
        """The link of this program; ConfigError for keys that cannot be used."""
        return Link(load_keys(self.keys), self)

    def port(self, stream: str) -> int:
        """Where a stream is bound."""
        return self.base_port + list(BOUND_BY).index(stream)

    def endpoint(self, stream: str) -> str:
        """Where the machine that binds a stream is found."""
        host = self.robot_host if BOUND_BY[stream] == "robot" else self.localizer_host
        return f"tcp://{host}:{self.port(stream)}"
