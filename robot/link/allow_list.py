"""Lets in the keys of the allow-list (ZAP, ZeroMQ RFC 27), each where its role may.

Every bound socket has a ZAP domain of its own, the name of its stream, so that it is known what
somebody wants. What a peer says of itself counts for nothing: our allow-list tells its role.
"""

from __future__ import annotations

import logging
import time
from typing import TYPE_CHECKING, Callable, Dict, List, Tuple

from robot.link.keys import ADMITS, Keys
from robot.link.telemetry import Reading
from robot.link.wire import tidy_text

if TYPE_CHECKING:
    import zmq

ENDPOINT = "inproc://zeromq.zap.01"
MAX_ADMISSIONS = 16  # in one call, so that a flood cannot hold up the control loop
TELL_EVERY_S = 10.0  # of one who knocks at one socket again and again
STRANGER = "a stranger"
SHOWN_BYTES = 24  # of a name in a report

logger = logging.getLogger(__name__)


class AllowList:
    """Answers those who knock at this program's bound sockets; never blocks."""

    def __init__(
        self,
        context: zmq.Context[zmq.Socket[bytes]],
        keys: Keys,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        import zmq
        from zmq.utils import z85

        self._clock, self._peers = clock, keys.peers
        self._names = {z85.decode(peer.public): name for name, peer in keys.peers.items()}
        self._names[z85.decode(keys.public)] = keys.role
        self._refused = 0
        self._told_s: Dict[Tuple[str, str], float] = {}
        self._newest = ""
        self.socket = context.socket(zmq.REP)
        self.socket.linger = 0
        self.socket.bind(ENDPOINT)

    def admit(self) -> None:
        """Answer those who wait."""
        import zmq

        for _ in range(MAX_ADMISSIONS):
            try:
                request = self.socket.recv_multipart(zmq.NOBLOCK)
            except zmq.Again:
                return
            self.socket.send_multipart(self._verdict(request))

    def may(self, name: str, stream: str) -> bool:
        """Whether the peer of this name in the allow-list may use a stream."""
        peer = self._peers.get(name)
        return peer is not None and peer.role in ADMITS[stream]

    def reading(self) -> Reading:
        """For the monitor: how many were turned away, and who was the last."""
        name = f"turned away: {self._newest}" if self._newest else "turned away"
        level = "warn" if self._refused else "ok"
        return Reading(tidy_text(name, SHOWN_BYTES), self._refused, "", level)

    def close(self) -> None:
        """Let nobody in any more."""
        self.socket.close()

    def _verdict(self, request: List[bytes]) -> List[bytes]:
        """Version, request id, domain, address, identity, mechanism, key -> the ZAP reply."""
        request_id = request[1] if len(request) > 1 else b""
        name, stream = STRANGER, ""
        if len(request) == 7 and request[5] == b"CURVE":
            name = self._names.get(request[6], STRANGER)
            stream = request[2].decode("ascii", "replace")
            if stream in ADMITS and self.may(name, stream):
                return [b"1.0", request_id, b"200", b"OK", name.encode(), b""]
        self._turn_away(name, stream, request[3] if len(request) > 3 else b"")
        return [b"1.0", request_id, b"400", b"not in the allow-list", b"", b""]

    def _turn_away(self, name: str, stream: str, address: bytes) -> None:
        self._refused += 1
        self._newest = name
        now_s = self._clock()
        if now_s - self._told_s.get((name, stream), -TELL_EVERY_S) < TELL_EVERY_S:
            return
        self._told_s[name, stream] = now_s
        who = name if name == STRANGER else f"the key of {name}"
        whom = " or ".join(ADMITS.get(stream, ("nobody",)))
        where = tidy_text(address.decode("ascii", "replace"), SHOWN_BYTES)
        logger.warning(
            "%s at %s was turned away from %r: expected a key of %s",
            *(who, where, tidy_text(stream, SHOWN_BYTES), whom),
        )
