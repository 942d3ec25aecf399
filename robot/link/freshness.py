"""Is what arrives new, in order, from one publisher and possible? Judged by the receiver's clock.

Silence gives no error on a network: only age does, and docs/links.md tells how that is counted.
"""

import math
from collections import Counter, deque
from typing import Deque, Optional, Tuple

from robot.contract import MAX_WHEEL_MPS
from robot.link.messages import PoseMessage

CLOCK_DRIFT = 2e-4  # two quartz clocks differ by at most 200 ppm
TAKEOVER_S = 1.0  # silence after which an earlier session may come back
REMEMBERED_SESSIONS = 16
MAX_SPEED_MPS = 1.25 * MAX_WHEEL_MPS  # at which a pose may move
MARGIN_M = 0.10  # of measurement noise and detection glitches
MIN_CONFIDENCE = 0.1
Bounds = Tuple[float, float, float, float]  # x_min, y_min, x_max, y_max [m]


class StreamGate:
    """Order and age of one stream. ``refused`` counts what was turned away, by reason."""

    def __init__(self) -> None:
        self.refused: Counter[str] = Counter()
        self._session: Optional[str] = None
        self._retired: Deque[str] = deque(maxlen=REMEMBERED_SESSIONS)
        self._sequence = -1
        self._arrival_s = -math.inf  # of the newest taken
        self._heard_s = -math.inf  # of the newest of the current session, taken or not
        self._conflict_until_s = -math.inf
        self._fastest_s = math.inf  # least arrival minus sending time, across the two clocks
        self._fastest_at_s = 0.0
        self._delay_s = 0.0

    def problem(self, session: str, sequence: int, now_s: float) -> str:
        """Why this message may not be used, or "".

        A new session is a restart and replaces the old one at once. When a replaced session speaks
        again while its successor lives, two publishers are at work: nothing is taken from either
        until one has been silent for ``TAKEOVER_S``.
        """
        if session == self._session:
            self._heard_s = now_s
        elif session in self._retired and now_s - self._heard_s < TAKEOVER_S:
            self._conflict_until_s = now_s + TAKEOVER_S
        else:
            if self._session is not None:
                self._retired.append(self._session)
            if session in self._retired:
                self._retired.remove(session)
            self._session, self._sequence, self._heard_s = session, -1, now_s
            self._fastest_s = math.inf
        if self.conflict(now_s):
            return "two publishers"
        return "" if sequence > self._sequence else "out of order"

    def take(
        self, sequence: int, t_sent_s: float, now_s: float, t_capture_s: Optional[float] = None
    ) -> None:
        """Note a message that has no ``problem`` as the newest."""
        self._sequence, self._arrival_s = sequence, now_s
        lag_s, drift_s = now_s - t_sent_s, CLOCK_DRIFT * (now_s - self._fastest_at_s)
        self._fastest_s = min(lag_s, self._fastest_s + drift_s)
        self._fastest_at_s = now_s
        capture_s = t_sent_s if t_capture_s is None else min(t_capture_s, t_sent_s)
        self._delay_s = (lag_s - self._fastest_s) + (t_sent_s - capture_s)

    def age_s(self, now_s: float) -> float:
        """Age [s] of the newest message taken; infinite when there was none."""
        return now_s - self._arrival_s + self._delay_s

    def conflict(self, now_s: float) -> bool:
        """Whether two publishers are at work on this stream."""
        return now_s < self._conflict_until_s


class PoseGate:
    """A ``StreamGate`` that also refuses poses of another robot, off the map, or out of reach.

    A jump is farther than ``MAX_SPEED_MPS`` x time + ``MARGIN_M`` from the last pose taken: a robot
    that was carried elsewhere is believed again once it could have driven there, and by then its
    pose is stale, so it stands.
    """

    def __init__(self, robot: str, bounds_m: Optional[Bounds] = None) -> None:
        self.latest: Optional[PoseMessage] = None
        self.stream = StreamGate()
        self._robot, self._bounds_m = robot, bounds_m
        self._taken_s = -math.inf

    def take(self, message: PoseMessage, now_s: float) -> bool:
        """Whether this pose may be used; it is then ``latest``."""
        stream = self.stream
        reason = stream.problem(message.session, message.sequence, now_s)
        if not reason and message.robot != self._robot:
            reason = "another robot"
        if not reason and message.confidence < MIN_CONFIDENCE:
            reason = "low confidence"
        reason = reason or self._place_problem(message, now_s)
        if reason:
            stream.refused[reason] += 1
            return False
        stream.take(message.sequence, message.t_sent_s, now_s, message.t_capture_s)
        self.latest, self._taken_s = message, now_s
        return True

    def _place_problem(self, message: PoseMessage, now_s: float) -> str:
        latest = self.latest
        if self._bounds_m is not None:
            x_min, y_min, x_max, y_max = self._bounds_m
            if not (x_min <= message.x_m <= x_max and y_min <= message.y_m <= y_max):
                return "off the map"
        if latest is None:
            return ""
        elapsed_s = now_s - self._taken_s
        if message.session == latest.session:
            elapsed_s = max(elapsed_s, message.t_capture_s - latest.t_capture_s)
        moved_m = math.hypot(message.x_m - latest.x_m, message.y_m - latest.y_m)
        return "jump" if moved_m > MAX_SPEED_MPS * elapsed_s + MARGIN_M else ""
