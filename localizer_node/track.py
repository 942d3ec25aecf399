"""From detections of single pictures to robots followed through time; never the wrong robot.

Time is what the caller passes: seconds of one monotonic clock. A pose is told as it was seen: who
fuses it with the steps of the wheels filters it, once.
"""

import math
from dataclasses import dataclass, field
from typing import Dict, List, Optional, Sequence, Tuple

from localizer_node.calibration import Calibration
from localizer_node.detect import Detection
from robot.errors import ContractError
from robot.link.messages import Sighting

MAX_SPEED_MPS = 0.8  # nothing of ours drives faster
MARGIN_M = 0.07  # of a sighting's error, and of a board that swings round its robot's origin
CONFIRM_HITS = 3  # pictures in which a robot is seen before its pose is told
REACQUIRE_HITS = 8  # as many at one other place in a row: it was carried there
ELSEWHERE_M = 0.05  # within which that is one place
FORGET_S = 1.0  # without being seen


@dataclass
class _Track:
    """One robot: where and when it was last seen, how often, and where it seems to be since."""

    last: Detection
    seen_s: float
    hits: int = 0
    elsewhere: List[Detection] = field(default_factory=list)

    def carried_to(self, seen: Detection) -> bool:
        """Seen out of reach once more; True when it was seen there often enough in a row."""
        if self.elsewhere and gap_m(seen, self.elsewhere[-1]) > ELSEWHERE_M:
            self.elsewhere = []
        self.elsewhere.append(seen)
        return len(self.elsewhere) >= REACQUIRE_HITS


def gap_m(one: Detection, other: Detection) -> float:
    """How far two detections are apart [m]."""
    return math.hypot(one.x_m - other.x_m, one.y_m - other.y_m)


class Tracker:
    """Follows the robots of one calibration."""

    def __init__(self, calibration: Calibration) -> None:
        self._robots = [marker.robot for marker in calibration.robots]
        self._tracks: Dict[str, _Track] = {}
        self._t_s = -math.inf

    def update(self, detections: Sequence[Detection], t_s: float) -> Tuple[Sighting, ...]:
        """The robots seen in the picture of ``t_s``; ContractError: not later than the last."""
        if t_s <= self._t_s:
            told = f"got one of {t_s:.4f} s after one of {self._t_s:.4f} s; use one monotonic clock"
            raise ContractError(f"tracker: expected pictures in the order they were taken, {told}")
        self._t_s = t_s
        tracks = self._tracks.items()
        self._tracks = {name: each for name, each in tracks if t_s - each.seen_s <= FORGET_S}
        poses = []
        for robot in self._robots:
            seen = self._chosen(robot, [d for d in detections if d.robot == robot])
            if seen is None:
                continue
            track = self._tracks.setdefault(robot, _Track(seen, t_s))
            track.last, track.seen_s, track.elsewhere = seen, t_s, []
            track.hits += 1
            if track.hits >= CONFIRM_HITS:
                poses.append(Sighting(robot, seen.x_m, seen.y_m, seen.heading_rad, seen.confidence))
        return tuple(poses)

    def _chosen(self, robot: str, candidates: List[Detection]) -> Optional[Detection]:
        """The one of several detections of this name that is this robot."""
        if not candidates:
            return None
        track = self._tracks.get(robot)
        if track is None:
            ranked = sorted(candidates, key=lambda d: -d.confidence)
            clear = len(ranked) == 1 or ranked[0].confidence > 1.5 * ranked[1].confidence
            return ranked[0] if clear else None
        near = min(candidates, key=lambda d: gap_m(d, track.last))
        if gap_m(near, track.last) <= MARGIN_M + MAX_SPEED_MPS * (self._t_s - track.seen_s):
            return near
        if len(candidates) == 1 and track.carried_to(near):
            del self._tracks[robot]
            return near
        return None
