"""What sight says of the lane, as measurements of where the robot is.

Successive pictures err alike. What lasts, as of a camera that is mounted askew, the filter carries
as states; the rest is given a larger variance, as much as errors that keep a share r of themselves
from one picture to the next are worth: (1 + r) / (1 - r) (Bartlett 1935, for the mean of such).
"""

import math
from typing import Iterator, Sequence, Tuple

import numpy as np

from robot.geometry import wrap_angle
from robot.navigation.fusion import SEEN, SEEN_LINE, PoseFusion
from robot.navigation.lane_view import LaneAhead, LaneView
from robot.vision.sight import Seen

USUAL_DELAY_S = 0.05  # of a picture, from the light to the robot
_DELAY_SHARE = 0.5  # of the angle turned since, by which the heading may be off for that
KEPT = 0.6  # of an error, from one picture to the next
_WIDER = (1.0 + KEPT) / (1.0 - KEPT)
_LEAST = np.array((0.005, 0.03, 0.3, 0.01))  # standard deviations of maps, paint and wheels
LINE = 0.5
_LINE_M = (0.1, 0.6)  # from the axle, where red lines are told apart
_ASKEW_RAD = 0.6  # in a junction, beyond which the lane meant may be another one's
_STEP, _NOTHING = 0.01, 1e6  # [m, rad]: who stands sees nothing new; deviation of the unseen


class SightFix:
    """Corrects the estimates of N robots, with ``sight``, by what they see on maps of ``views``."""

    def __init__(self, fusion: PoseFusion, views: Sequence[LaneView]) -> None:
        self.fusion, self.views = fusion, list(views)
        self._at, self._looks = np.full((len(self.views), 3), np.nan), np.zeros(len(self.views))
        self.took_s = np.full(len(self.views), -math.inf)  # when each was last corrected

    def see(self, seen: Seen, fresh: np.ndarray, now_s: float) -> np.ndarray:
        """Take what N pictures show that came now; ``fresh`` (N,) tells whose is a new one.

        Gives how far from the map's lane that is, as `PoseFusion.correct`.
        """
        captured_s = np.full(len(fresh), now_s - USUAL_DELAY_S)
        sure = fresh & seen.in_lane
        self._looks *= np.abs(self.fusion.poses - self._at).max(axis=1) < _STEP
        moved = self._looks < _WIDER
        far = self.fusion.correct(lambda *told: self._lane(seen, sure, *told), captured_s, moved)
        self.took_s = np.where(far < self.fusion.config.gate, now_s, self.took_s)
        lined = sure & moved & (seen.line > LINE)
        if lined.any():
            self.fusion.correct(lambda *told: self._line(seen, lined, *told), captured_s, lined)
        taken = moved & (far < self.fusion.config.gate)
        self._at = np.where(taken[:, None], self.fusion.poses, self._at)
        self._looks += taken
        return far

    def _lane(
        self, seen: Seen, asked: np.ndarray, poses: np.ndarray, since: np.ndarray
    ) -> Tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Offset, heading and curvature ahead."""
        innovation, design, noise = _empty(len(asked), 3)
        error = self.fusion.seen_error()
        for i, road in self._roads(asked, poses):
            c, s = math.cos(road.along_rad), math.sin(road.along_rad)
            along, left = np.array(((c, s), (-s, c)))
            expected = np.array((road.offset_m, road.heading_rad, road.curvature_pm))
            expected[:2] += error[i, :2]
            innovation[i] = seen.figures[i, :3] - expected
            innovation[i, 1] = wrap_angle(innovation[i, 1])
            design[i, 0, :2] = left
            design[i, 1, :2] = -road.bend_pm * along
            design[i, 1, 2] = 1.0
            design[i, 2, :2] = road.slope_pm2 * along
            design[i, (0, 1), (SEEN.start, SEEN.start + 1)] = 1.0
            spread = _WIDER * (seen.deviations[i, :3] ** 2 + _LEAST[:3] ** 2)
            spread[1] += (_DELAY_SHARE * since[i, 2]) ** 2
            if math.isnan(innovation[i, 2]):
                innovation[i, 2], spread[2] = 0.0, _NOTHING
            noise[i] = np.diag(spread)
        return innovation, design, noise

    def _line(
        self, seen: Seen, asked: np.ndarray, poses: np.ndarray, _since: np.ndarray
    ) -> Tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The way to the red line."""
        innovation, design, noise = _empty(len(asked), 1)
        (near, far), scales = _LINE_M, 1.0 + self.fusion.seen_error()[:, 2]
        for i, road in self._roads(asked, poses):
            seen_m = float(seen.figures[i, 3])
            if math.isfinite(road.line_m) and near <= seen_m <= far:
                along = np.array((math.cos(road.along_rad), math.sin(road.along_rad)))
                innovation[i] = seen_m - scales[i] * road.line_m
                design[i, 0, :2] = -scales[i] * along
                design[i, 0, SEEN_LINE] = road.line_m
                noise[i] = _WIDER * (seen.deviations[i, 3] ** 2 + _LEAST[3] ** 2)
        return innovation, design, noise

    def _roads(self, asked: np.ndarray, poses: np.ndarray) -> Iterator[Tuple[int, LaneAhead]]:
        """The roads before those who are asked, where the map has one."""
        for i in np.flatnonzero(asked & np.isfinite(poses[:, 0])).tolist():
            road = self.views[i].at(*poses[i].tolist())
            if road is not None and not (road.in_junction and abs(road.heading_rad) > _ASKEW_RAD):
                yield i, road


def _empty(count: int, figures: int) -> Tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Innovation, design and covariance of robots of whom nothing was measured."""
    noise = np.repeat(np.eye(figures)[None], count, axis=0)
    return np.full((count, figures), np.nan), np.zeros((count, figures, SEEN.stop)), noise
