"""Where a person drove next, told as a navigator is told its way."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress

import numpy as np

from robot.errors import PlanError
from robot.geometry import Pose
from robot.navigation.path import path_input
from robot.navigation.planner import LaneGraph, plan_path
from trainer.twin.recorded import Recorded

AHEAD_M, DETOUR = 0.6, 1.5  # beyond what a path input tells; how much longer the way may be


def ways_driven(drive: Recorded) -> list[Sequence[float] | None]:
    """What a navigator would have been told of the way that was driven next, at each picture.

    A person who drives has no mission, so the lanes between the place where the robot believed to
    be and that where it came are asked of the map. None where no such way leads there.
    """
    told = drive.fused if len(drive.fused) else drive.overhead
    times_s, poses = told[:, 0], np.column_stack((told[:, 1:3], np.unwrap(told[:, 3])))
    gone_m = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(poses[:, :2], axis=0).T))))
    graph, found = LaneGraph(drive.road_map), list[Sequence[float] | None]()
    for time_s, turn in zip(drive.times_s, drive.turns, strict=True):
        here = Pose(*(float(np.interp(time_s, times_s, part)) for part in poses.T))
        then = int(np.searchsorted(gone_m, np.interp(time_s, times_s, gone_m) + AHEAD_M))
        way: Sequence[float] | None = turn.path
        if way is None and then < len(poses):
            with suppress(PlanError):
                path = plan_path(graph, here, (poses[then, 0], poses[then, 1]))
                if path.length_m < DETOUR * AHEAD_M:
                    way = path_input(path, here).tolist()
        found.append(way)
    return found
