"""``WayOn``: how a robot without a destination drives on: in its lane, as straight as it can."""

from __future__ import annotations

from typing import NamedTuple, Optional

from robot.errors import PlanError
from robot.geometry import Pose
from robot.navigation.path import Path, PathPosition
from robot.navigation.planner import LaneGraph, path_on
from robot.navigation.sight_fix import SightFix

_SEEN_S = 1.0  # over the middle of a junction
_SHOWN_M, _LEFT_M = 1.2, 0.6  # of the way when it is laid, and before it is laid anew


class On(NamedTuple):
    """A way on, and where a robot is on it."""

    path: Path
    pose: Pose
    at: PathPosition
    seen: bool  # whether pictures showed a lane there of late


class WayOn:
    """The way on of one robot on the map of a graph, laid anew before it ends."""

    def __init__(self, graph: LaneGraph) -> None:
        self._graph = graph
        self._path: Optional[Path] = None

    def lay(self, pose: Pose) -> bool:
        """Anew, from a pose on; False, and none, off the road."""
        try:
            self._path = path_on(self._graph, pose, _SHOWN_M)
        except PlanError:
            self._path = None
        return self._path is not None

    def on(self, fix: SightFix, now_s: float, robot: int = 0) -> Optional[On]:
        """The way of a robot whose place a filter knows; None off the road."""
        pose = Pose(*fix.fusion.poses[robot].tolist())
        if self._path is None and not self.lay(pose):
            return None
        assert self._path is not None
        at = self._path.project(pose.x_m, pose.y_m)
        if self._path.length_m - at.arc_m < _LEFT_M and self.lay(pose):
            at = self._path.project(pose.x_m, pose.y_m)
        if self._path is None:
            return None
        return On(self._path, pose, at, now_s - float(fix.took_s[robot]) <= _SEEN_S)
