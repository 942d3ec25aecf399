"""A link without a network: what was sent arrives when the test hands it over."""

from __future__ import annotations

from collections import deque
from typing import Any, Deque, List, Set, Tuple


class FakePart:
    """A received part: bytes, and who sent them."""

    def __init__(self, data: bytes, user: str) -> None:
        self.bytes = data
        self._user = user

    def get(self, name: str) -> str:
        assert name == "User-Id"
        return self._user


class FakeSocket:
    """Gives what waits, keeps what is sent; every call must be one that never blocks."""

    def __init__(self) -> None:
        self.waiting: Deque[List[Any]] = deque()
        self.sent: List[bytes] = []
        self.connected = True

    def recv_multipart(self, flags: int, copy: bool = True) -> List[Any]:
        import zmq

        assert flags == zmq.NOBLOCK
        if not self.waiting:
            raise zmq.Again
        return self.waiting.popleft()

    def recv(self, flags: int) -> bytes:
        return bytes(self.recv_multipart(flags)[-1])

    def send_multipart(self, parts: List[bytes], flags: int) -> None:
        import zmq

        assert flags == zmq.NOBLOCK
        self.sent.append(parts[-1])

    def send(self, data: bytes, flags: int = 0) -> None:
        import zmq

        if not self.connected:
            assert flags == zmq.NOBLOCK
            raise zmq.Again
        self.sent.append(data)


class FakeLink:
    """One socket; ``monitors`` are the names that may command."""

    def __init__(self, monitors: Tuple[str, ...] = ("monitor",)) -> None:
        self.socket = FakeSocket()
        self.allow_list = self
        self.admitted = 0
        self.reconnected: List[str] = []
        self.opened: Set[Tuple[object, ...]] = set()
        self._monitors = monitors

    def bind(self, stream: str, limit_bytes: int) -> FakeSocket:
        self.opened.add(("bind", stream, limit_bytes))
        return self.socket

    def connect(self, stream: str, limit_bytes: int) -> FakeSocket:
        self.opened.add(("connect", stream, limit_bytes))
        return self.socket

    def may(self, name: str, stream: str) -> bool:
        assert stream == "command"
        return name in self._monitors

    def admit(self) -> None:
        self.admitted += 1

    def reconnect(self, socket: object, stream: str) -> None:
        assert socket is self.socket
        self.reconnected.append(stream)


class FakeClock:
    """A clock that we set."""

    def __init__(self, now_s: float = 100.0) -> None:
        self.now_s = now_s

    def __call__(self) -> float:
        return self.now_s
