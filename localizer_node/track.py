"""From detections of single pictures to robots followed through time; never the wrong robot.

Time is what the caller passes: seconds of one monotonic clock.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Dict, List, Optional, Sequence, Tuple

import numpy as np

from localizer_node.calibration import Calibration, Marker
from localizer_node.detect import Detection
from localizer_node.kalman import FloorFilter, HeadingFilter
from robot.errors import ContractError

GATE = 5.0  # standard deviations
SIGMA_M = {"two_colour": 0.003, "tag": 0.002, "plain": 0.004}
SIGMA_RAD = math.radians(0.8)
MAX_SPEED_MPS = 0.8  # nothing of ours drives faster
CONFIRM_HITS = 3  # pictures in which a robot is seen before its pose is told
REACQUIRE_HITS = 8  # as many at one other place in a row: it was carried there
FORGET_S = 1.0  # without being seen
CLEAR_RATIO = 3.0  # how much nearer the one board must be to its track than any other


@dataclass(frozen=True)
class RobotPose:
    """Where a robot was when a picture was taken; world frame."""

    robot: str
    x_m: float
    y_m: float
    heading_rad: Optional[float]  # None for a plain board
    vx_mps: float
    vy_mps: float
    turn_radps: float
    confidence: float  # 0..1
    frame: int
    t_capture_s: float


class _Track:
    """One robot; its filter follows the middle of the board, which is known before the front is."""

    def __init__(self, marker: Marker, detection: Detection) -> None:
        self.marker = marker
        self.floor = FloorFilter(middle_of(detection, marker), SIGMA_M[detection.kind])
        self.heading: Optional[HeadingFilter] = None
        self.hits = 1
        self.unseen_s = 0.0
        self.confidence = detection.confidence
        self.elsewhere: List[np.ndarray] = []
        self._learn_heading(detection)

    def predict(self, dt_s: float) -> None:
        self.floor.predict(dt_s)
        if self.heading is not None:
            self.heading.predict(dt_s)
        self.unseen_s += dt_s

    def reach_m(self, sigma_m: float) -> float:
        """How far from its prediction this robot may be seen."""
        spread = math.sqrt(float(self.floor.covariance[0, 0]) + sigma_m**2)
        return min(GATE * spread, 0.03 + MAX_SPEED_MPS * (self.unseen_s + 0.05))

    def gap_m(self, detection: Detection) -> float:
        """How far a detection is from where this robot should be."""
        return float(np.linalg.norm(middle_of(detection, self.marker) - self.floor.position_m))

    def update(self, detection: Detection) -> None:
        sigma = SIGMA_M[detection.kind] * doubt(detection)
        self.floor.update(middle_of(detection, self.marker), sigma)
        self._learn_heading(detection)
        self.hits += 1
        self.unseen_s = 0.0
        self.elsewhere = []
        self.confidence += 0.3 * (detection.confidence - self.confidence)

    def _learn_heading(self, detection: Detection) -> None:
        if detection.heading_rad is None:
            return
        sigma = SIGMA_RAD * doubt(detection)
        if self.heading is None:
            self.heading = HeadingFilter(detection.heading_rad, sigma)
        else:
            self.heading.update(detection.heading_rad, sigma)

    def carried_to(self, detection: Detection) -> bool:
        """Seen out of reach once more; True when it was seen there often enough in a row."""
        place = middle_of(detection, self.marker)
        if self.elsewhere and np.linalg.norm(place - self.elsewhere[-1]) > 0.05:
            self.elsewhere = []
        self.elsewhere.append(place)
        return len(self.elsewhere) >= REACQUIRE_HITS


def doubt(detection: Detection) -> float:
    """How many times less sure than a clean sighting: what fits badly is misplaced as well."""
    return 1.0 / max(detection.confidence, 0.1) ** 2


def middle_of(detection: Detection, marker: Marker) -> np.ndarray:
    """Where the middle of the board is, (2,) [m]."""
    place = np.array([detection.x_m, detection.y_m])
    if detection.heading_rad is None:
        return place
    angle = detection.heading_rad
    return place + marker.board.forward_m * np.array([math.cos(angle), math.sin(angle)])


class Tracker:
    """Follows the robots of one calibration."""

    def __init__(self, calibration: Calibration) -> None:
        self._markers: Dict[str, Marker] = {m.robot: m for m in calibration.robots}
        self._tracks: Dict[str, _Track] = {}
        self._t_s: Optional[float] = None

    def update(
        self, detections: Sequence[Detection], t_s: float, frame: int
    ) -> Tuple[RobotPose, ...]:
        """Take in the detections of the picture taken at ``t_s``; the robots seen in it.

        Raises:
            ContractError: ``t_s`` is not later than the last picture's.
        """
        self._advance(t_s)
        taken: Dict[str, Detection] = {}
        for robot in self._markers:
            chosen = self._named(robot, [d for d in detections if d.robot == robot])
            if chosen is not None:
                taken[robot] = chosen
        self._add_nameless([d for d in detections if not d.robot], taken)
        for robot, detection in taken.items():
            if robot in self._tracks:
                self._tracks[robot].update(detection)
            else:
                self._tracks[robot] = _Track(self._markers[robot], detection)
        lost = [r for r, track in self._tracks.items() if track.unseen_s > FORGET_S]
        for robot in lost:
            del self._tracks[robot]
        poses = (self._pose(robot, frame, t_s) for robot in taken)
        return tuple(pose for pose in poses if pose is not None)

    def predicted(self, t_s: float) -> Dict[str, Tuple[float, float, float]]:
        """x, y and reach [m] of where each followed robot will be seen at ``t_s``."""
        dt_s = max(t_s - (t_s if self._t_s is None else self._t_s), 0.0)
        result = {}
        for robot, track in self._tracks.items():
            x, y = track.floor.position_m + dt_s * track.floor.velocity_mps
            result[robot] = (float(x), float(y), 0.03 + MAX_SPEED_MPS * (track.unseen_s + dt_s))
        return result

    def _advance(self, t_s: float) -> None:
        dt_s = 0.0 if self._t_s is None else t_s - self._t_s
        if self._t_s is not None and dt_s <= 0.0:
            raise ContractError(
                f"tracker: expected pictures in the order they were taken, got one of {t_s:.4f} s "
                f"after one of {self._t_s:.4f} s; use one monotonic clock"
            )
        self._t_s = t_s
        for track in self._tracks.values():
            track.predict(dt_s)

    def _named(self, robot: str, candidates: List[Detection]) -> Optional[Detection]:
        """The one of several detections of this name that is this robot."""
        if not candidates:
            return None
        track = self._tracks.get(robot)
        if track is None:
            ranked = sorted(candidates, key=lambda d: -d.confidence)
            clear = len(ranked) == 1 or ranked[0].confidence > 1.5 * ranked[1].confidence
            return ranked[0] if clear else None
        gaps = [track.gap_m(d) for d in candidates]
        near = candidates[int(np.argmin(gaps))]
        if min(gaps) <= track.reach_m(SIGMA_M[near.kind]):
            return near
        if len(candidates) == 1 and track.carried_to(near):
            del self._tracks[robot]
            return near
        return None

    def _add_nameless(self, boards: List[Detection], taken: Dict[str, Detection]) -> None:
        """Boards whose tag could not be read go to the one track that they clearly continue."""
        names = [r for r in self._tracks if r not in taken and self._markers[r].kind == "tag"]
        if not (boards and names):
            return
        tracks = [self._tracks[r] for r in names]
        gaps = np.array([[track.gap_m(board) for board in boards] for track in tracks])
        for i, name in enumerate(names):
            j = int(np.argmin(gaps[i]))
            rivals = [*np.delete(gaps[i], j), *np.delete(gaps[:, j], i)]
            within = gaps[i, j] <= tracks[i].reach_m(SIGMA_M["plain"])
            if within and min(rivals, default=math.inf) > max(CLEAR_RATIO * gaps[i, j], 0.06):
                taken[name] = boards[j]

    def _pose(self, robot: str, frame: int, t_s: float) -> Optional[RobotPose]:
        track = self._tracks[robot]
        if track.hits < CONFIRM_HITS:
            return None
        known = track.heading
        (x, y), (vx, vy), turn = track.floor.position_m, track.floor.velocity_mps, 0.0
        if known is not None:
            turn = known.turn_radps
            ahead = self._markers[robot].board.forward_m
            c, s = ahead * math.cos(known.heading_rad), ahead * math.sin(known.heading_rad)
            x, y, vx, vy = x - c, y - s, vx + turn * s, vy - turn * c
        heading = None if known is None else known.heading_rad
        confidence = float(np.clip(track.confidence, 0.0, 1.0))
        place = (float(x), float(y), heading, float(vx), float(vy), float(turn))
        return RobotPose(robot, *place, confidence, frame, t_s)
