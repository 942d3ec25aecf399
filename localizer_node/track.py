"""From detections of single pictures to robots followed through time; never the wrong robot.

Time is what the caller passes: seconds of one monotonic clock. The filter is of Bar-Shalom, Li and
Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001, 6.3.
"""

from __future__ import annotations

import math
from typing import Dict, List, Optional, Sequence, Tuple

import numpy as np

from localizer_node.calibration import Calibration, Marker
from localizer_node.detect import Detection
from robot.errors import ContractError
from robot.geometry import wrap_angle
from robot.link.messages import Sighting

GATE = 5.0  # standard deviations
SIGMA_M, SIGMA_RAD = 0.003, math.radians(0.8)  # of a clean sighting
START_MPS, START_RADPS = 0.3, 2.0  # standard deviations of the rates at first
ACCELERATION_MPS2 = 2.0  # standard deviation: a stepper starts and stops within a tenth of a second
ACCELERATION_RADPS2 = 40.0  # from one hard turn to the other as fast
MAX_SPEED_MPS = 0.8  # nothing of ours drives faster
CONFIRM_HITS = 3  # pictures in which a robot is seen before its pose is told
REACQUIRE_HITS = 8  # as many at one other place in a row: it was carried there
ELSEWHERE_M = 0.05  # within which that is one place
FORGET_S = 1.0  # without being seen


class RateFilter:
    """Follows ``value`` (N,) and its ``rate``; all coordinates share one covariance (2, 2).

    Places [m], or an angle [rad] in (-pi, pi]. Standard deviations: of the first measurement, of
    the rate that it may have, and of what changes the rate.
    """

    def __init__(
        self,
        value: np.ndarray,
        sigma: float,
        rate_sigma: float,
        acceleration: float,
        is_angle: bool = False,
    ) -> None:
        self.value = np.array(value, dtype=float)
        self.rate = np.zeros_like(self.value)
        self.covariance = np.diag([sigma**2, rate_sigma**2])
        self._acceleration, self._is_angle = acceleration, is_angle

    def predict(self, dt_s: float) -> None:
        """Move on by ``dt_s``."""
        f = np.array([[1.0, dt_s], [0.0, 1.0]])
        g = np.array([0.5 * dt_s * dt_s, dt_s]) * self._acceleration
        self.value = self._wrapped(self.value + dt_s * self.rate)
        self.covariance = f @ self.covariance @ f.T + np.outer(g, g)

    def update(self, value: np.ndarray, sigma: float) -> None:
        """Take in a measured value."""
        gain = self.covariance[:, 0] / (self.covariance[0, 0] + sigma**2)
        error = self._wrapped(np.asarray(value) - self.value)
        self.value = self._wrapped(self.value + gain[0] * error)
        self.rate = self.rate + gain[1] * error
        self.covariance = self.covariance - np.outer(gain, self.covariance[0])

    def _wrapped(self, value: np.ndarray) -> np.ndarray:
        return np.asarray(wrap_angle(value)) if self._is_angle else value


class _Track:
    """One robot; its filter follows the middle of the board, which is known without a front."""

    def __init__(self, marker: Marker, seen: Detection) -> None:
        self.marker, self.confidence, self.hits, self.unseen_s = marker, seen.confidence, 1, 0.0
        self.floor = RateFilter(middle_of(seen, marker), SIGMA_M, START_MPS, ACCELERATION_MPS2)
        self.heading: Optional[RateFilter] = None
        if seen.heading_rad is not None:
            angle, rates = np.array([seen.heading_rad]), (START_RADPS, ACCELERATION_RADPS2)
            self.heading = RateFilter(angle, SIGMA_RAD * doubt(seen), *rates, is_angle=True)
        self.elsewhere: List[np.ndarray] = []

    def predict(self, dt_s: float) -> None:
        self.floor.predict(dt_s)
        if self.heading is not None:
            self.heading.predict(dt_s)
        self.unseen_s += dt_s

    @property
    def reach_m(self) -> float:
        """How far from its prediction this robot may be seen."""
        spread = math.sqrt(float(self.floor.covariance[0, 0]) + SIGMA_M**2)
        return min(GATE * spread, 0.03 + MAX_SPEED_MPS * (self.unseen_s + 0.05))

    def gap_m(self, detection: Detection) -> float:
        return float(np.linalg.norm(middle_of(detection, self.marker) - self.floor.value))

    def update(self, detection: Detection) -> None:
        self.floor.update(middle_of(detection, self.marker), SIGMA_M * doubt(detection))
        if self.heading is not None and detection.heading_rad is not None:
            self.heading.update(np.array([detection.heading_rad]), SIGMA_RAD * doubt(detection))
        self.hits, self.unseen_s, self.elsewhere = self.hits + 1, 0.0, []
        self.confidence += 0.3 * (detection.confidence - self.confidence)

    def carried_to(self, detection: Detection) -> bool:
        """Seen out of reach once more; True when it was seen there often enough in a row."""
        place = middle_of(detection, self.marker)
        if self.elsewhere and np.linalg.norm(place - self.elsewhere[-1]) > ELSEWHERE_M:
            self.elsewhere = []
        self.elsewhere.append(place)
        return len(self.elsewhere) >= REACQUIRE_HITS

    def pose(self) -> Sighting:
        """Of the robot's origin, behind the middle of the board."""
        (x_m, y_m), heading_rad = self.floor.value.tolist(), None
        if self.heading is not None:
            heading_rad = float(self.heading.value[0])
            x_m -= self.marker.board.forward_m * math.cos(heading_rad)
            y_m -= self.marker.board.forward_m * math.sin(heading_rad)
        sure = min(max(self.confidence, 0.0), 1.0)
        return Sighting(self.marker.robot, x_m, y_m, heading_rad, sure)


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
        self._t_s = -math.inf

    def update(self, detections: Sequence[Detection], t_s: float) -> Tuple[Sighting, ...]:
        """Take in the detections of the picture taken at ``t_s``; the robots seen in it.

        ContractError: ``t_s`` is not later than the last picture's.
        """
        if t_s <= self._t_s:
            raise ContractError(
                f"tracker: expected pictures in the order they were taken, got one of {t_s:.4f} s "
                f"after one of {self._t_s:.4f} s; use one monotonic clock"
            )
        for track in self._tracks.values():
            track.predict(t_s - self._t_s)
        self._t_s = t_s
        poses = []
        for robot, marker in self._markers.items():
            seen = self._chosen(robot, [d for d in detections if d.robot == robot])
            if seen is None:
                continue
            if robot in self._tracks:
                self._tracks[robot].update(seen)
            track = self._tracks.setdefault(robot, _Track(marker, seen))
            if track.hits >= CONFIRM_HITS:
                poses.append(track.pose())
        self._tracks = {r: track for r, track in self._tracks.items() if track.unseen_s <= FORGET_S}
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
        near = min(candidates, key=track.gap_m)
        if track.gap_m(near) <= track.reach_m:
            return near
        if len(candidates) == 1 and track.carried_to(near):
            del self._tracks[robot]
            return near
        return None
