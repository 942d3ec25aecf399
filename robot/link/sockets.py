"""ZeroMQ sockets for the three machines: newest-only streams, encrypted, without a thread.

The side that binds lets in the keys of its allow-list, each where its role may;
the side that connects pins the key of the machine it means. A ``Link`` belongs to one thread; its
sockets are served by their own calls, which never block.

One socket per stream and one part per message, because CONFLATE (set on the subscriber only) drops
parts and breaks topic filters (libzmq #626, #1688, #3323).
"""

from __future__ import annotations

import contextlib
import copy
import re
import secrets
import time
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Callable, Generic, List, Optional, Sequence, Tuple, Type, TypeVar

from robot.errors import ConfigError, ContractError, expect_between
from robot.link.keys import ADMITS, ALLOWED, BOUND_BY, PUBLIC, AllowList, Keys, load_keys
from robot.link.messages import Command, FrameMessage, PosesMessage, Telemetry

if TYPE_CHECKING:
    import zmq

Clock = Callable[[], float]
M = TypeVar("M", PosesMessage, FrameMessage, Telemetry)
ENVELOPE_BYTES = 64  # what CURVE adds to a message, with room to spare
HEARTBEAT_MS = 200
HEARTBEAT_TIMEOUT_MS = 600
RECONNECT_MS = 50
HANDSHAKE_MS = 2000  # whoever has not shown a key by then is put out; who connects waits DEAF_S
CONNECT_TIMEOUT_MS = 500  # without it a lost SYN on Wi-Fi costs seconds
DEAF_S = 2.0
SEND_QUEUE = 2
RECEIVE_QUEUE = 16
DESCRIPTORS = 65_536


@dataclass(frozen=True)
class OtherRobot:
    """One that shares this one's roads; ``name`` is its own, and that of its key."""

    name: str
    host: str
    base_port: int = 5570


@dataclass(frozen=True)
class LinkConfig:
    """The links of one program, as its YAML file says them."""

    keys: str  # this machine's folder of ``robot keygen``
    robot_host: str = "127.0.0.1"
    localizer_host: str = "127.0.0.1"
    base_port: int = 5570
    robots: Tuple[OtherRobot, ...] = ()  # of a robot: who tells it where they are

    def __post_init__(self) -> None:
        expect_between("base_port", self.base_port, 1024, 65535 - len(BOUND_BY))
        for host in (self.robot_host, self.localizer_host, *(each.host for each in self.robots)):
            if not re.fullmatch(r"[A-Za-z0-9](\.?[A-Za-z0-9_-])*", host):
                raise ConfigError(f"host: expected a name or an IPv4 address alone, got {host!r}")

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


class Link:
    """The sockets of one program, its keys and its allow-list. Close it, or use it as a context."""

    def __init__(self, keys: Keys, config: LinkConfig) -> None:
        import zmq

        self.keys, self.config = keys, config
        self._context = zmq.Context()
        self._sockets: List[zmq.Socket[bytes]] = []
        raise_limit()
        self.allow_list = AllowList(self._context, keys)

    def bind(self, stream: str, limit_bytes: int) -> zmq.Socket[bytes]:
        """A socket that waits for those whom a stream admits; commands are answered.

        ConfigError where our keys are not those of the machine that binds it, or the port is taken.
        """
        import zmq

        self._expect_role((BOUND_BY[stream],))
        socket = self._socket(zmq.ROUTER if stream == Command.KIND else zmq.PUB, limit_bytes)
        # Who connects asks for signs of life, and tells with them how long to wait for the next.
        # Who binds must not ask: libzmq 4.3.5 aborts when it wants to ask somebody who filled the
        # queue and hung up (libzmq #4841).
        socket.heartbeat_ivl = 0
        socket.rcvhwm = RECEIVE_QUEUE
        socket.curve_server = True
        socket.zap_domain = stream.encode("ascii")
        socket.zap_enforce_domain = True  # without a list nobody enters
        endpoint = f"tcp://*:{self.config.port(stream)}"
        try:
            socket.bind(endpoint)
        except zmq.ZMQError as error:
            raise ConfigError(
                f"{endpoint}: expected a free port of this machine, got: {error}; does the program "
                "run already? choose another base_port otherwise"
            ) from error
        return socket

    def connect(self, stream: str, limit_bytes: int) -> zmq.Socket[bytes]:
        """A socket that speaks to the machine that binds a stream, alone.

        Of what is published it keeps the newest message only. ConfigError where the stream does not
        admit our keys, or we do not know that machine's.
        """
        import zmq

        self._expect_role(ADMITS[stream])
        socket = self._socket(zmq.DEALER if stream == Command.KIND else zmq.SUB, limit_bytes)
        if stream == Command.KIND:
            socket.immediate = True  # what is sent while nobody is connected is lost, not queued
        else:
            socket.conflate = True
            socket.subscribe(b"")
        socket.curve_serverkey = self.keys.peer(BOUND_BY[stream])
        socket.connect(self.config.endpoint(stream))
        return socket

    def reconnect(self, socket: zmq.Socket[bytes], stream: str) -> None:
        """Connect again a socket that has heard nothing for ``DEAF_S``.

        libzmq reconnects after a lost connection, but gives one up for good after an oversized
        message or a refusal, which a new key in the allow-list may have mended.
        """
        import zmq

        with contextlib.suppress(zmq.ZMQError):  # it may have forgotten the endpoint already
            socket.disconnect(self.config.endpoint(stream))
        socket.connect(self.config.endpoint(stream))

    def to(self, other: OtherRobot) -> Link:
        """This link, as it speaks to another robot; ConfigError: we do not know its key."""
        key = self.keys.peers.get(other.name)
        if key is None or key.role != "robot":
            known = f"{ALLOWED}/{other.name}.key"
            raise ConfigError(f"keys: expected a robot's in {known}, got none; copy its {PUBLIC}")
        link = copy.copy(self)  # with the same context and sockets
        link.keys = replace(self.keys, peers={other.name: key})
        link.config = replace(self.config, robot_host=other.host, base_port=other.base_port)
        return link

    def close(self) -> None:
        """Close every socket, the allow-list's last."""
        for socket in (*self._sockets, self.allow_list.socket):
            socket.close()
        self._context.term()

    def __enter__(self) -> Link:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _socket(self, kind: int, limit_bytes: int) -> zmq.Socket[bytes]:
        socket = self._context.socket(kind)
        socket.curve_publickey, socket.curve_secretkey = self.keys.public, self.keys.secret
        socket.linger = 0
        socket.sndhwm = SEND_QUEUE
        socket.maxmsgsize = limit_bytes + ENVELOPE_BYTES
        socket.heartbeat_ivl = HEARTBEAT_MS
        socket.heartbeat_timeout = HEARTBEAT_TIMEOUT_MS
        socket.heartbeat_ttl = HEARTBEAT_TIMEOUT_MS
        socket.handshake_ivl = HANDSHAKE_MS
        socket.reconnect_ivl = RECONNECT_MS
        socket.connect_timeout = CONNECT_TIMEOUT_MS
        self._sockets.append(socket)
        return socket

    def _expect_role(self, roles: Sequence[str]) -> None:
        if self.keys.role not in roles:
            expected = " or ".join(roles)
            told = f"{self.keys.role}; name the folder {roles[0]}/ that keygen made"
            raise ConfigError(f"keys: expected those of the {expected}, got those of the {told}")


def raise_limit() -> None:
    """Let this program have as many descriptors as it may, up to ``DESCRIPTORS``.

    Whoever reaches a port can open connections and say nothing; each costs a descriptor until
    ``HANDSHAKE_MS`` are over, and a program without one can open no camera and no file.
    """
    with contextlib.suppress(ImportError, ValueError, OSError):  # no Unix; macOS says too much
        import resource

        soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
        most = DESCRIPTORS if hard == resource.RLIM_INFINITY else min(hard, DESCRIPTORS)
        if soft != resource.RLIM_INFINITY and soft < most:
            resource.setrlimit(resource.RLIMIT_NOFILE, (most, hard))


def receive_now(socket: zmq.Socket[bytes], copy: bool = True) -> Optional[List]:
    """The parts of a message that has come, or None; never blocks."""
    import zmq

    try:
        return list(socket.recv_multipart(zmq.NOBLOCK, copy=copy))
    except zmq.Again:
        return None


def new_session() -> str:
    """A name for one run of a publisher or of the robot: 16 random hexadecimal digits."""
    return secrets.token_hex(8)


class Publisher(Generic[M]):
    """Publishes the stream of a class; ``send`` never blocks."""

    def __init__(self, link: Link, kind: Type[M], clock: Clock = time.monotonic) -> None:
        self.session = new_session()
        self._link, self._clock = link, clock
        self._sequence = 0
        self._socket = link.bind(kind.KIND, kind.LIMIT_BYTES)

    def send(self, message: M) -> M:
        """Stamp the message with session, sequence and time, and publish it; as sent."""
        self._link.allow_list.admit()
        self._sequence += 1
        sequence, now_s = self._sequence, self._clock()
        stamped = replace(message, session=self.session, sequence=sequence, t_sent_s=now_s)
        self._socket.send(stamped.to_bytes())
        return stamped


class Subscriber(Generic[M]):
    """The newest message of the stream of a class; ``freshness`` judges order, age and place."""

    def __init__(self, link: Link, kind: Type[M], clock: Clock = time.monotonic) -> None:
        self.refused, self.last_refusal = 0, ""
        self._link, self._clock = link, clock
        self._alive_s = clock()  # last heard or connected
        self._kind: Type[M] = kind
        self._socket = link.connect(kind.KIND, kind.LIMIT_BYTES)

    def receive(self) -> Optional[M]:
        """The newest message since the last call, or None; never blocks."""
        parts = receive_now(self._socket)
        if parts is None:
            if self._clock() - self._alive_s > DEAF_S:
                self._alive_s = self._clock()
                self._link.reconnect(self._socket, self._kind.KIND)
            return None
        self._alive_s = self._clock()
        try:
            return self._kind.from_bytes(parts[-1])
        except ContractError as error:
            self.refused += 1
            self.last_refusal = str(error)
            return None
