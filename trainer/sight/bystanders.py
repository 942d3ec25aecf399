"""Who stands in the way, or beside it, while pictures for sight are taken; none of them is met."""

import math
from collections.abc import Iterator, Sequence

import numpy as np

from robot.geometry import Pose
from robot.navigation.lane_view import LaneView
from robot.navigation.map_objects import MapObject, colours
from robot.navigation.neighbours import AHEAD_M, HALF_DUCK_M, HALF_ROBOT_M, Other, free_way
from robot.navigation.road_map import RoadMap
from robot.safety.governors import NOSE_M
from sim_pybullet.scene import Mover, Solid
from sim_pybullet.scenery.object_solids import object_solids
from sim_pybullet.tasks.navigation import Navigation

_DUCKS, _ROBOTS = 4, 3
_DUCKS_M, _ROBOTS_M = (0.05, 0.08), (0.11, 0.14)  # least and greatest height
_ANEW = 0.08  # chance in a decision that others stand there
_THERE = 0.35  # of one of them to stand there at all
_FROM_AXLE_M = (0.12, 1.0)
_ON_LANE = 0.4  # their share
_HALF_LANE_M, _EDGE_M, _BESIDE_M = 0.08, 0.09, 0.41  # most ducks beside it stand by its edge
_ROBOTS_LEFT_M = (0.23, -0.26)  # of the lane's middle: who comes the other way, who is parked
_LOW_M = 0.1  # what begins higher is in nobody's way
_WIDE, _WIDER = 1.2, 1.4  # times its width what is no duck is in the way, and nobody can tell


class Bystanders(Navigation):
    """`Navigation` past ducks and robots on the lane and beside it, now here, now there."""

    def __init__(self, maps: Sequence[RoadMap], robots: int, spread: float, seed: int) -> None:
        super().__init__(maps, robots, spread)
        self._rng = np.random.default_rng((seed, 3))
        self.movers = tuple(_movers(self._rng))
        self._places = np.full((robots, len(self.movers), 3), np.nan)
        self._near_m = NOSE_M + np.repeat((HALF_DUCK_M, HALF_ROBOT_M), (_DUCKS, _ROBOTS))

    def think(self, poses: np.ndarray) -> None:
        """Others come and go; who would be driven through is gone."""
        anew = self._rng.random(self.n_robots) < _ANEW
        self._places[anew] = self._drawn()[anew]
        delta = self._places[..., :2] - poses[:, None, :2]
        self._places[np.hypot(delta[..., 0], delta[..., 1]) < self._near_m] = np.nan

    def _drawn(self) -> np.ndarray:
        """(N, U, 3) places by the paths of all robots."""
        rng, shape = self._rng, self._places.shape[:2]
        robots = np.arange(shape[1]) >= _DUCKS
        off = rng.uniform(-1.0, 1.0, shape)
        ducks_m = np.sign(off) * (_EDGE_M + _BESIDE_M * off**2)
        beside_m = np.where(robots, rng.choice(_ROBOTS_LEFT_M, shape), ducks_m)
        left_m = np.where(rng.random(shape) < _ON_LANE, _HALF_LANE_M * (1 + robots) * off, beside_m)
        arc_m = self.course.arc_m[:, None] + rng.uniform(*_FROM_AXLE_M, shape)
        along, points = self.paths.headings_at(arc_m), self.paths.points_at(arc_m)
        aside = np.stack((-np.sin(along), np.cos(along)), axis=-1)
        turned = rng.uniform(-1.0, 1.0, shape) * np.where(robots, 0.2, math.pi)
        turned += np.where(robots & (left_m > 0.5 * _ROBOTS_LEFT_M[0]), math.pi, 0.0)
        places = np.dstack((points + left_m[..., None] * aside, along + turned))
        places[rng.random(shape) > _THERE] = np.nan
        return places

    def moving(self, poses: np.ndarray, share: float = 1.0) -> np.ndarray:  # noqa: ARG002
        """As of `Task`."""
        return self._places


def _movers(rng: np.random.Generator) -> Iterator[Mover]:
    names = list(colours())
    for kind, sizes_m, count in (("duckie", _DUCKS_M, _DUCKS), ("duckiebot", _ROBOTS_M, _ROBOTS)):
        for height_m in rng.uniform(*sizes_m, count).tolist():
            colour = names[int(rng.integers(len(names)))]
            yield object_solids(MapObject("", kind, 0.0, 0.0, 0.0, height_m, color=colour))


def standing(solids: Sequence[Solid]) -> list[Other]:
    """What of these solids is in the way of who would drive there."""
    low = [each for each in solids if each.base_m < _LOW_M]
    return [Other(each.x_m, each.y_m, half_m=0.5 * max(each.size_m[:2])) for each in low]


def half_m(mover: Mover) -> float:
    """From its middle to its edge; NaN where it is in nobody's way."""
    return max((part.half_m for part in standing(mover)), default=math.nan)


def clear_m(view: LaneView, pose: Pose, others: Sequence[Other]) -> tuple[float, float]:
    """From the nose along the own lane to the nearest of others: at most, and at least.

    They differ where something stands so near beside the lane that nobody can tell.
    """
    near = [o for o in others if math.hypot(o.x_m - pose.x_m, o.y_m - pose.y_m) < AHEAD_M[-1]]
    way_m = view.way(pose, AHEAD_M) if near else None
    if way_m is None:
        return math.inf, math.inf
    wide = [o._replace(half_m=_WIDE * o.half_m) if o.half_m > HALF_DUCK_M else o for o in near]
    wider = [o._replace(half_m=_WIDER * o.half_m) for o in near]
    most_m, least_m = (free_way(way_m, pose, each).free_m for each in (wide, wider))
    return most_m, least_m
