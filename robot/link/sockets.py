"""ZeroMQ sockets for the three machines: newest-only streams, encrypted, without a thread.

The side that binds is the door: it lets in the public keys of its allow-list (ZAP, ZeroMQ RFC 27)
and nobody else; the side that connects pins the key of the machine it means. A ``Link`` belongs to
one thread; its sockets are served by ``Link.wait`` and by their own calls, which never block.

One socket per stream and one part per message, because CONFLATE (set on the subscriber only) drops
parts and breaks topic filters (libzmq #626, #1688, #3323).
"""

from __future__ import annotations

import contextlib
import time
from typing import TYPE_CHECKING, List, Optional

from robot.errors import ConfigError
from robot.link.keys import Keys

if TYPE_CHECKING:
    import zmq

LOOPBACK = ("tcp://127.0.0.1:", "tcp://localhost:", "tcp://[::1]:", "inproc://", "ipc://")
ZAP_ENDPOINT = "inproc://zeromq.zap.01"
ZAP_DOMAIN = b"duckpilot"
ENVELOPE_BYTES = 64  # what CURVE adds to a message, with room to spare
HEARTBEAT_MS = 200
HEARTBEAT_TIMEOUT_MS = 600
RECONNECT_MS = 50
CONNECT_TIMEOUT_MS = 500  # without it a lost SYN on Wi-Fi costs seconds
DEAF_S = 2.0
SEND_QUEUE = 2
RECEIVE_QUEUE = 16
MAX_ADMISSIONS = 16  # doorkeeping in one call, so that a flood cannot hold up the control loop


class Link:
    """The sockets of one program, its keys and its door. Close it, or use it as a context."""

    def __init__(self, keys: Optional[Keys], plaintext: bool = False) -> None:
        import zmq

        if (keys is None) != plaintext:
            raise ConfigError(
                "link: expected either keys (make them with: robot keygen DIR) or plaintext, "
                f"got {'neither' if keys is None else 'both'}"
            )
        self.keys = keys
        self._context = zmq.Context()
        self._poller = zmq.Poller()
        self._sockets: List[zmq.Socket[bytes]] = []
        self._door: Optional[zmq.Socket[bytes]] = None
        if keys is not None:
            self._names = {key: name for name, key in keys.peers.items()}
            self._door = self._context.socket(zmq.REP)
            self._door.linger = 0
            self._door.bind(ZAP_ENDPOINT)
            self._poller.register(self._door, zmq.POLLIN)

    def bind(self, kind: int, endpoint: str, limit_bytes: int) -> zmq.Socket[bytes]:
        """A socket of the ZeroMQ ``kind`` that waits for peers of the allow-list."""
        socket = self._socket(kind, endpoint, limit_bytes)
        # Who connects asks for signs of life, and tells with them how long to wait for the next.
        # Who binds must not ask: libzmq 4.3.5 aborts when it wants to ask somebody who filled the
        # queue and hung up (libzmq #4841).
        socket.heartbeat_ivl = 0
        socket.rcvhwm = RECEIVE_QUEUE
        if self.keys is not None:
            socket.curve_server = True
            socket.zap_domain = ZAP_DOMAIN
            socket.zap_enforce_domain = True  # without a doorkeeper nobody enters
            socket.curve_publickey, socket.curve_secretkey = self.keys.public, self.keys.secret
        socket.bind(endpoint)
        return socket

    def connect(
        self, kind: int, endpoint: str, limit_bytes: int, peer: str, newest_only: bool = False
    ) -> zmq.Socket[bytes]:
        """A socket of the ZeroMQ ``kind`` that speaks to the machine ``peer`` and to no other."""
        socket = self._socket(kind, endpoint, limit_bytes)
        if newest_only:
            socket.conflate = True
            socket.subscribe(b"")
        else:
            socket.immediate = True  # what is sent while nobody is connected is lost, not queued
        if self.keys is not None:
            socket.curve_serverkey = self.keys.peer(peer)
            socket.curve_publickey, socket.curve_secretkey = self.keys.public, self.keys.secret
        socket.connect(endpoint)
        return socket

    def reconnect(self, socket: zmq.Socket[bytes], endpoint: str) -> None:
        """Connect again a socket that has heard nothing for ``DEAF_S``.

        libzmq reconnects after a lost connection, but gives one up for good after an oversized
        message or a refusal at the door, which a new key in the allow-list may have mended.
        """
        import zmq

        with contextlib.suppress(zmq.ZMQError):  # it may have forgotten the endpoint already
            socket.disconnect(endpoint)
        socket.connect(endpoint)

    def wait(self, timeout_s: float) -> bool:
        """Wait until something may have arrived, at most ``timeout_s``; admits peers meanwhile."""
        deadline_s = time.monotonic() + timeout_s
        while True:
            left_s = max(0.0, deadline_s - time.monotonic())
            ready = dict(self._poller.poll(int(1000 * left_s)))
            if self._door is not None and ready.pop(self._door, None):
                self.admit()
            if ready or time.monotonic() >= deadline_s:
                return bool(ready)

    def admit(self) -> None:
        """Answer those who wait at the door, without blocking."""
        import zmq

        for _ in range(MAX_ADMISSIONS if self._door is not None else 0):
            assert self._door is not None
            try:
                request = self._door.recv_multipart(zmq.NOBLOCK)
            except zmq.Again:
                return
            self._door.send_multipart(self._verdict(request))

    def close(self) -> None:
        """Close every socket, the door last."""
        for socket in self._sockets:
            socket.close()
        if self._door is not None:
            self._door.close()
        self._context.term()

    def __enter__(self) -> Link:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _socket(self, kind: int, endpoint: str, limit_bytes: int) -> zmq.Socket[bytes]:
        import zmq

        if self.keys is None and not endpoint.startswith(LOOPBACK):
            raise ConfigError(
                f"{endpoint}: expected a loopback address without keys, got one that others reach; "
                "make keys with: robot keygen DIR"
            )
        socket = self._context.socket(kind)
        socket.linger = 0
        socket.sndhwm = SEND_QUEUE
        socket.maxmsgsize = limit_bytes + ENVELOPE_BYTES
        socket.heartbeat_ivl = HEARTBEAT_MS
        socket.heartbeat_timeout = HEARTBEAT_TIMEOUT_MS
        socket.heartbeat_ttl = HEARTBEAT_TIMEOUT_MS
        socket.reconnect_ivl = RECONNECT_MS
        socket.connect_timeout = CONNECT_TIMEOUT_MS
        self._sockets.append(socket)
        if kind != zmq.PUB:
            self._poller.register(socket, zmq.POLLIN)
        return socket

    def _verdict(self, request: List[bytes]) -> List[bytes]:
        """Version, request id, domain, address, identity, mechanism, key -> the ZAP reply."""
        name = None
        if len(request) == 7 and request[2] == ZAP_DOMAIN and request[5] == b"CURVE":
            from zmq.utils import z85

            name = self._names.get(z85.encode(request[6]))
        request_id = request[1] if len(request) > 1 else b""
        if name is None:
            return [b"1.0", request_id, b"400", b"not in the allow-list", b"", b""]
        return [b"1.0", request_id, b"200", b"OK", name.encode(), b""]
