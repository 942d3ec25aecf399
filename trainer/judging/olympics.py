"""The AI Driving Olympics' figures: of a drive, and of a driver in a challenge, how sure.

Those of a drive are by duckietown-world's rules (`in_drivable_lane.py`). Its lanes are not ours:
0.376 tiles wide, their middle 0.22 tiles beside the road's, on bends drawn through three poses by
constant twists. Along them its figures are counted, quirks included: a tile counts in the lane that
was used there first, and no lane at all is no deviation. One thing is ours: the deviation is in
metres, where theirs is in tiles.
"""

import cmath
import itertools
import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple, Self

import numpy as np
from rich.console import Console
from rich.table import Table

from robot.geometry import Pose, wrap_angle
from robot.navigation.road_map import ORIENTATIONS, RoadMap, Tile
from trainer.judging.films import Filmed, keep_films
from trainer.judging.intervals import Estimate, median, paired, share
from trainer.report.page import Picture, write_page

SURVIVED = "time"
LANE_TILES = 0.376
# Poses that a lane leads through, in tiles and degrees; it comes from the west. By the quarters of
# a junction that it passes: to the right, straight on, to the left.
_THROUGH = {
    1: ((-0.5, -0.22, 0.0), (-0.3, -0.3, -45.0), (-0.22, -0.5, -90.0)),
    2: ((-0.5, -0.22, 0.0), (0.5, -0.22, 0.0)),
    3: ((-0.5, -0.22, 0.0), (0.0, 0.0, 45.0), (0.22, 0.5, 90.0)),
}
_ZONE_M = 0.35  # before a junction, measured at the axle
_STILL_MPS = 0.02
_LEAST_TTC_S = 0.5  # nearer to a collision nobody should come
_WEST = ORIENTATIONS.index("W")
_STEPS = 64  # between two poses of a bend: exact to 0.01 mm


class LaneFigures(NamedTuple):
    """One drive. Names are the Olympics', with underscores."""

    survival_time: float  # [s]
    driven_lanedir_consec: float  # [m] along the first lane of each tile
    deviation_center_line: float  # [m s]: its distance over time, 0 where there is no lane
    in_drivable_lane: float  # [s] without a lane within 90 degrees
    deviation_heading: float  # [rad s]
    distance_from_start: float  # [m], the greatest


class _Lane(NamedTuple):
    """Where one pose is in a lane of its tile."""

    askew_rad: float  # either way
    name: int
    lateral_m: float
    middle: np.ndarray  # (3,) the nearest pose of the lane, in the world


class LaneRules:
    """Judges drives on one map."""

    def __init__(self, road_map: RoadMap) -> None:
        self._map, self.tile_size_m = road_map, road_map.tile_size_m
        self._half_m = 0.5 * LANE_TILES * road_map.tile_size_m

    def lines_run(self, poses: np.ndarray, dt_s: float) -> int:
        """How many junctions a drive as below entered without standing before them.

        A robot must stand somewhere on the last `_ZONE_M`; who began nearer is not judged.
        """
        way_m = np.hypot(*np.diff(poses[:, :2], axis=0).T)
        tiles = [self._map.tile_at(x_m, y_m) for x_m, y_m in poses[:, :2].tolist()]
        inside = np.array([tile is not None and tile.is_junction for tile in tiles])
        driven_m, run = np.concatenate(([0.0], np.cumsum(way_m))), 0
        for k in (np.flatnonzero(inside[1:] & ~inside[:-1]) + 1).tolist():
            first = int(np.searchsorted(driven_m, driven_m[k] - _ZONE_M))
            run += first > 0 and not (way_m[first:k] < _STILL_MPS * dt_s).any()
        return run

    def figures(self, poses: np.ndarray, dt_s: float) -> LaneFigures:
        """Of a drive through poses (T, 3), one each ``dt_s``; T is at least 1."""
        lanes = [self._lanes(pose) for pose in poses[:-1]]
        seen = [where[0] for where in lanes if where]
        return LaneFigures(
            dt_s * len(lanes),
            self._driven_m(poses, lanes),
            dt_s * sum(abs(lane.lateral_m) for lane in seen),
            dt_s * (len(lanes) - len(seen)),
            dt_s * sum(lane.askew_rad for lane in seen),
            float(np.hypot(*(poses[:, :2] - poses[0, :2]).T).max()),
        )

    def _driven_m(self, poses: np.ndarray, lanes: Sequence[list[_Lane]]) -> float:
        """Along the lanes, on each tile along that of them which was the first there."""
        first: dict[tuple[int, int], int] = {}
        total_m = 0.0
        for pose, then, where in zip(poses, poses[1:], lanes, strict=False):
            tile = self._map.tile_at(pose[0], pose[1])
            if where and tile is not None:
                used = first.setdefault((tile.row, tile.column), where[0].name)
                ways = [Pose(*at.middle).to_robot(then[:2])[0] for at in where if at.name == used]
                total_m += max(map(float, ways), default=0.0)
        return total_m

    def _lanes(self, pose: np.ndarray) -> list[_Lane]:
        """The lanes that a pose is in, best aligned first."""
        tile = self._map.tile_at(pose[0], pose[1])
        if tile is None or not tile.is_road:
            return []
        size_m = self._map.tile_size_m
        centre = np.array([tile.column + 0.5, self._map.rows - tile.row - 0.5]) * size_m
        found = []
        for name, course in enumerate(_courses(tile)):
            middle = _abeam(course * (size_m, size_m, 1.0) + (*centre, 0.0), pose[:2])
            if middle is None:
                continue
            lateral_m = float(Pose(*middle).to_robot(pose[:2])[1])
            askew_rad = abs(float(wrap_angle(pose[2] - middle[2])))
            if abs(lateral_m) <= self._half_m and askew_rad <= 0.5 * math.pi:
                found.append(_Lane(askew_rad, name, lateral_m, middle))
        return sorted(found, key=lambda lane: lane[:2])


def longest_wait_s(poses: np.ndarray, dt_s: float) -> float:
    """How long a drive through poses (T, 3), one each ``dt_s``, stood still at a time."""
    stood = np.hypot(*np.diff(poses[:, :2], axis=0).T) < _STILL_MPS * dt_s
    changes = np.flatnonzero(np.diff(np.concatenate(([False], stood, [False]))))
    return dt_s * float(np.diff(changes)[::2].max(initial=0))


def _abeam(lane: np.ndarray, point: np.ndarray) -> np.ndarray | None:
    """The pose of a lane (P, 3) that has a point (2,) exactly beside it; None if none has."""
    c, s = np.cos(lane[:, 2]), np.sin(lane[:, 2])
    ahead = c * (point[0] - lane[:, 0]) + s * (point[1] - lane[:, 1])
    found = np.flatnonzero((ahead[:-1] >= 0.0) & (ahead[1:] < 0.0))
    if not len(found):
        return None
    shares = ahead[found] / (ahead[found] - ahead[found + 1])
    poses = lane[found] + shares[:, None] * (lane[found + 1] - lane[found])
    return np.asarray(poses[np.hypot(*(poses[:, :2] - point).T).argmin()])


@cache
def _courses(tile: Tile) -> tuple[np.ndarray, ...]:
    """The lanes of a tile, each (P, 3) in tiles from its middle: from every side to every other."""
    sides = [ORIENTATIONS.index(side) for side in tile.road_sides]
    ways = ((entry, quarters) for entry in sides for quarters in (1, 2, 3))
    return tuple(_course(*way) for way in ways if sum(way) % 4 in sides)


def _course(entry: int, quarters: int) -> np.ndarray:
    through = [(x, y, math.radians(degrees)) for x, y, degrees in _THROUGH[quarters]]
    legs = [_screw(a, b)[:-1] for a, b in itertools.pairwise(through)]
    x, y, heading = np.concatenate((*legs, [through[-1]])).T
    way, turn = (x + 1j * y) * 1j ** (entry - _WEST), 0.5 * math.pi * ((entry - _WEST) % 4)
    return np.column_stack((way.real, way.imag, heading + turn))


def _screw(a: Sequence[float], b: Sequence[float]) -> np.ndarray:
    """(P, 3) poses from a to b by a constant twist: interpolation in SE(2)."""
    share, turn = np.linspace(0.0, 1.0, _STEPS + 1), b[2] - a[2]
    first, last = complex(a[0], a[1]), complex(b[0], b[1])
    if turn == 0.0:
        way = first + share * (last - first)
    else:  # about the point that stays where it is
        whole = cmath.exp(1j * turn)
        centre = (last - whole * first) / (1.0 - whole)
        way = centre + np.exp(1j * turn * share) * (first - centre)
    return np.column_stack((way.real, way.imag, a[2] + share * turn))


class Episode(NamedTuple):
    """One episode of one robot."""

    seed: int
    robot: int  # of those that share a world
    end: str  # `SURVIVED`, or what ended it before its time
    at_fault: bool  # in the collision that ended it
    success: bool  # survived, and drove three tiles
    least_ttc_s: float  # time to collision, the least
    longest_wait_s: float  # at rest
    map: str
    lines_run: int  # red lines at which it did not stand
    tiles: float  # along the lane
    figures: LaneFigures

    @property
    def badness(self) -> tuple[float, ...]:
        """Larger is worse."""
        return (not self.success, -self.tiles, -self.seed, -self.robot)


# Units of `LaneFigures`, whose names are the Olympics' with underscores, in the order of a table.
MEASURES = {
    "survival_time": "s",
    "driven_lanedir_consec": "m",
    "deviation-center-line": "m s",
    "in-drivable-lane": "s",
    "deviation-heading": "rad s",
    "distance-from-start": "m",
}


@dataclass(frozen=True)
class Verdict:
    """One driver's."""

    driver: str
    episodes: Sequence[Episode]

    @property
    def figures(self) -> dict[str, Estimate]:
        """Shares, and medians by the Olympics' names.

        A collision counts that is its own fault; to survive without three tiles is no success. The
        half second is of the time to a collision, kept all the time.
        """
        every, count = self.episodes, len(self.episodes)
        columns = zip(*(e.figures for e in every), strict=True)
        apart = sum(e.least_ttc_s >= _LEAST_TTC_S for e in every)
        return {
            "collision_free_rate": share(sum(not e.at_fault for e in every), count),
            "success_rate": share(sum(e.success for e in every), count),
            "tiles": median([e.tiles for e in every]),
            **{name: median(each) for name, each in zip(MEASURES, columns, strict=True)},
            "least_time_to_collision": median([e.least_ttc_s for e in every]),
            "half_second_kept_rate": share(apart, count),
            "longest_wait": median([e.longest_wait_s for e in every]),
        }

    @property
    def ends(self) -> dict[str, int]:
        """What ended episodes before their time, whose fault it was, red lines run; how many."""
        found: Counter[str] = Counter()
        for each in self.episodes:
            if each.end != SURVIVED:
                others = each.end.startswith("collision") and not each.at_fault
                found[each.end + "_by_others" * others] += 1
            found["line_run"] += each.lines_run
        return {name: count for name, count in sorted(found.items()) if count}

    def plain(self) -> dict[str, Any]:
        """For JSON."""
        rows = [{**each._asdict(), "figures": each.figures._asdict()} for each in self.episodes]
        return {
            "driver": self.driver,
            **{name: found.value for name, found in self.figures.items()},
            "intervals": {name: [found.low, found.high] for name, found in self.figures.items()},
            "infractions": self.ends,
            "longest_wait_of_all": max(each.longest_wait_s for each in self.episodes),
            "drives": rows,
        }

    def against(self, other: Self) -> dict[str, Any]:
        """Both on the same episodes: who succeeded where the other did not."""
        mine, theirs = ([e.success for e in v.episodes] for v in (self, other))
        return {**other.plain(), **paired(mine, theirs)}


def tell(console: Console, challenge: str, verdicts: Sequence[Verdict]) -> None:
    """A column for each driver, and who did better where there are two."""
    table = Table("", *(v.driver for v in verdicts), title=f"{challenge}, medians and 95 %")
    every = [verdict.figures for verdict in verdicts]
    for name in every[0]:
        told = ([round(figure, 2) + 0.0 for figure in each[name]] for each in every)  # no -0.00
        cells = [f"{value:.2f} ({low:.2f} to {high:.2f})" for value, low, high in told]
        table.add_row(f"{name} [{MEASURES[name]}]" if name in MEASURES else name, *cells)
    ends = [", ".join(f"{k} {n}" for k, n in v.ends.items()) or "none" for v in verdicts]
    table.add_row("infractions", *ends)
    console.print(table, markup=False)
    if len(verdicts) > 1:
        found = verdicts[0].against(verdicts[1])
        console.print(
            f"only {verdicts[0].driver} succeeded: {found['only_first']}, only "
            f"{verdicts[1].driver}: {found['only_second']}; McNemar p = {found['p_value']:.3g}"
        )


def write_worst(out: Path, films: Sequence[Filmed], verdict: Verdict, challenge: str) -> Path:
    """The worst of these films of a verdict's episodes, and the page that shows them."""
    shown = [Picture(name, path, "Its end.") for name, path in keep_films(films, out, "worst")]
    title = f"{verdict.driver}, {challenge}: {len(verdict.episodes)} episodes"
    rows = [(name, *(f"{x:.2f}" for x in each)) for name, each in verdict.figures.items()]
    write_page("judge.html", out / "judge.html", title=title, rows=rows, films=shown)
    return out / "judge.html"
