"""A localizer that can do what a real one must not: be late, jump, contradict itself."""

from __future__ import annotations

import secrets
from collections import deque
from collections.abc import Callable
from typing import TYPE_CHECKING

import zmq

from robot.geometry import Pose, wrap_angle
from robot.link.keys import Keys, load_keys
from robot.link.messages import PosesMessage, Sighting
from robot.link.sockets import Link
from tools.loop.shared_time import SharedTime
from tools.loop.town import OVERHEAD_FPS, ROBOT
from tools.loop.wire_watch import let_sockets_wait

if TYPE_CHECKING:
    from tools.loop.bench import Bench

# Of a true pose, the time since the lie began [s], and the true pose of then.
Lie = Callable[[Pose, float, Pose], Pose]


class StandIn:
    """Publishes the robot's true pose with the localizer's own keys, and lies when told to."""

    def __init__(self, bench: Bench, shared: SharedTime, keys: Keys | None = None) -> None:
        config = bench.link_configs["localizer"]
        self.late_s = 0.0
        self.clock_step_s = 0.0
        self.backwards = False
        self.twins = False  # two sessions at once
        self.instead: list[bytes] = []  # sent in place of poses
        self._bench = bench
        self.lies(lambda pose, *_: pose)
        self._shared = shared
        let_sockets_wait()
        self._link = Link(keys or load_keys(config.keys), config)
        self._socket = self._link.bind(zmq.PUB, PosesMessage.KIND, 2**21)
        self._sessions = (secrets.token_hex(8), secrets.token_hex(8))
        self._sequence = 0
        self._waiting: deque[tuple[float, PosesMessage]] = deque()
        self._event = bench.time.every(1.0 / OVERHEAD_FPS, self._tell)

    def close(self) -> None:
        """Fall silent."""
        self._bench.time.forget(self._event)
        self._link.close()

    def lies(self, lie: Lie) -> None:
        """From now on tell what ``lie`` makes of the true pose."""
        self._lie, self._since_s, self._first = lie, self._bench.now_s, self._bench.town.pose

    def _send(self, data: bytes) -> None:
        self._link.allow_list.admit()
        self._socket.send(data)

    def _tell(self) -> None:
        for data in self.instead:
            self._send(data)
        if not self.instead:
            self._tell_pose()

    def _tell_pose(self) -> None:
        self._sequence += 1
        bench_s = self._bench.now_s
        told = self._lie(self._bench.town.pose, bench_s - self._since_s, self._first)
        x_m, y_m, heading_rad = told
        seen = Sighting(ROBOT, float(x_m), float(y_m), float(wrap_angle(heading_rad)), 0.95)
        now_s = bench_s + self.clock_step_s
        session = self._sessions[self._sequence % 2 if self.twins else 0]
        sequence = 10**6 - self._sequence if self.backwards else 10**6 + self._sequence
        stamped = PosesMessage((seen,), now_s, session, sequence, now_s)
        self._waiting.append((bench_s + self.late_s, stamped))
        while self._waiting and self._waiting[0][0] <= bench_s:
            sent = self._waiting.popleft()[1]
            self._send(sent.to_bytes())
            self._shared.publish(sent.KIND, sent.session, sent.sequence)
