"""Many robots on paths at once: nearest points, progress and points ahead, without Python loops."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Optional, Sequence, Tuple

import numpy as np

from robot.geometry import wrap_angle

if TYPE_CHECKING:
    from robot.navigation.path import Path

NO_HINT = -1  # in an array of hints: search the whole path
_REACH = 16  # segments searched on either side of a hint; the search moves on while it improves
# What a segment holds: start x, y; vector x, y; 1 / squared length; heading at its start; its turn.
_X, _DX, _INVERSE, _HEADING, _TURN, _WIDTH = 0, 2, 4, 5, 6, 7


@dataclass(frozen=True, eq=False)
class PathPositions:
    """Where N positions lie on their paths; see `robot.navigation.path.PathPosition`."""

    index: np.ndarray  # (N,) int, the hint for the next call
    arc_m: np.ndarray  # (N,)
    offset_m: np.ndarray  # (N,) positive to the left
    heading_rad: np.ndarray  # (N,)


class PathBatch:
    """N robots on one shared path, or each on a path of its own, padded to the longest.

    Args:
        paths: P paths.
        path_of: (N,) the path of every robot. Without it robot i is on path i, and where there is
            only one path all robots are on it.
    """

    def __init__(self, paths: Sequence[Path], path_of: Optional[np.ndarray] = None) -> None:
        count = len(paths)
        self._path_of = np.arange(count) if path_of is None else np.array(path_of, dtype=int)
        self._shared = path_of is None and count == 1
        self._segments = np.zeros((count, max(len(p.headings_rad) for p in paths), _WIDTH))
        self._counts = np.zeros(count, dtype=int)
        self._steps_m = np.zeros(count)
        self._closed = np.zeros(count, dtype=bool)
        for i, path in enumerate(paths):
            self.replace(i, path)

    def replace(self, path_index: int, path: Path) -> None:
        """Put another path in the place of one, as when a robot gets a new destination."""
        segments = path.segments
        count, room = len(segments), self._segments.shape[1]
        if count > room:
            self._segments = np.pad(self._segments, ((0, 0), (0, count - room), (0, 0)))
        self._segments[path_index, :count] = segments
        self._counts[path_index] = count
        self._steps_m[path_index] = path.length_m / count
        self._closed[path_index] = path.closed

    @property
    def length_m(self) -> np.ndarray:
        """Length of every path (P,)."""
        return self._counts * self._steps_m

    def project(self, xy_m: np.ndarray, hint: Optional[np.ndarray] = None) -> PathPositions:
        """The nearest point of each robot's path to its position.

        Args:
            xy_m: (N, 2) positions in the world.
            hint: (N,) ``index`` of the last call, `NO_HINT` where there is none. With a hint the
                search follows the path from there, so that a crossing path does not distract it;
                its time does not depend on the path's length.
        """
        xy_m = np.asarray(xy_m, dtype=float)
        paths = self._paths(len(xy_m))
        hint = np.full(len(xy_m), NO_HINT) if hint is None else np.asarray(hint)
        index = np.minimum(hint, self._counts[paths] - 1)
        fraction = np.zeros(len(xy_m))
        lost, todo = np.flatnonzero(index < 0), np.flatnonzero(index >= 0)
        if len(lost):
            everything = np.arange(self._counts[paths[lost]].max())
            window = np.minimum(everything, self._counts[paths[lost], None] - 1)
            best, fraction[lost] = self._nearest(xy_m[lost], paths[lost], window)
            index[lost] = window[np.arange(len(lost)), best]
        for _ in range(int(self._counts.max()) // _REACH + 2):
            if not len(todo):
                break
            window = self._window(paths[todo], index[todo])
            best, fraction[todo] = self._nearest(xy_m[todo], paths[todo], window)
            index[todo] = window[np.arange(len(todo)), best]
            todo = todo[self._may_go_on(paths[todo], index[todo], best)]
        return self._positions(xy_m, paths, index, fraction)

    def points_at(self, arc_m: np.ndarray) -> np.ndarray:
        """Points (N, K, 2) at arc lengths (N, K) [m]; an open path goes on straight at its ends."""
        paths = self._paths(len(arc_m))
        index, fraction = self._locate(paths, arc_m)
        segment = self._segments[paths[:, None], index]
        inside = np.clip(fraction, 0.0, 1.0)
        points = segment[..., _X:_DX] + inside[..., None] * segment[..., _DX:_INVERSE]
        beyond_m = (fraction - inside) * self._steps_m[paths, None]
        if beyond_m.any():
            heading = self._heading(segment, inside)
            points += beyond_m[..., None] * np.stack((np.cos(heading), np.sin(heading)), axis=-1)
        return points

    def headings_at(self, arc_m: np.ndarray) -> np.ndarray:
        """Headings (N, K) [rad] at arc lengths (N, K) [m]."""
        paths = self._paths(len(arc_m))
        index, fraction = self._locate(paths, arc_m)
        return self._heading(self._segments[paths[:, None], index], np.clip(fraction, 0.0, 1.0))

    def index_at(self, arc_m: np.ndarray) -> np.ndarray:
        """The hints (N,) of robots that are known to be at arc lengths (N,) [m]."""
        return np.asarray(self._locate(self._paths(len(arc_m)), arc_m[:, None])[0][:, 0])

    def advance_m(self, before_m: np.ndarray, after_m: np.ndarray) -> np.ndarray:
        """Progress (N,) from one arc length to another, the short way round on a closed path."""
        paths = self._paths(len(after_m))
        length_m = self.length_m[paths]
        gain_m = np.asarray(after_m) - before_m
        round_m = (gain_m + 0.5 * length_m) % length_m - 0.5 * length_m
        return np.where(self._closed[paths], round_m, gain_m)

    def _paths(self, robots: int) -> np.ndarray:
        return np.zeros(robots, dtype=int) if self._shared else self._path_of

    def _window(self, paths: np.ndarray, centre: np.ndarray) -> np.ndarray:
        """Segment indices (N, 2 * _REACH + 1) around a centre, on the path."""
        window = centre[:, None] + np.arange(-_REACH, _REACH + 1)
        counts = self._counts[paths, None]
        return np.where(self._closed[paths, None], window % counts, np.clip(window, 0, counts - 1))

    def _nearest(
        self, xy_m: np.ndarray, paths: np.ndarray, window: np.ndarray
    ) -> Tuple[np.ndarray, np.ndarray]:
        """Column (N,) of the nearest segment of each window (N, W), and how far along it."""
        segment = self._segments[paths[:, None], window]
        vector = segment[..., _DX:_INVERSE]
        delta = xy_m[:, None] - segment[..., _X:_DX]
        along = (delta[..., 0] * vector[..., 0] + delta[..., 1] * vector[..., 1]) * segment[
            ..., _INVERSE
        ]
        along = np.clip(along, 0.0, 1.0)
        delta = delta - along[..., None] * vector
        best = (delta[..., 0] ** 2 + delta[..., 1] ** 2).argmin(axis=1)
        return best, along[np.arange(len(best)), best]

    def _may_go_on(self, paths: np.ndarray, index: np.ndarray, best: np.ndarray) -> np.ndarray:
        """Where the nearest segment is the window's last one and the path goes on beyond it."""
        at_edge = (best == 0) | (best == 2 * _REACH)
        ends = (index == 0) | (index == self._counts[paths] - 1)
        return at_edge & (self._closed[paths] | ~ends)

    def _positions(
        self, xy_m: np.ndarray, paths: np.ndarray, index: np.ndarray, fraction: np.ndarray
    ) -> PathPositions:
        segment = self._segments[paths, index]
        vector = segment[:, _DX:_INVERSE]
        delta = xy_m - segment[:, _X:_DX]
        cross = vector[:, 0] * delta[:, 1] - vector[:, 1] * delta[:, 0]
        return PathPositions(
            index,
            (index + fraction) * self._steps_m[paths],
            cross * np.sqrt(segment[:, _INVERSE]),
            self._heading(segment, fraction),
        )

    def _locate(self, paths: np.ndarray, arc_m: np.ndarray) -> Tuple[np.ndarray, np.ndarray]:
        """Segment and fraction along it (outside 0 to 1 beyond an open path) of arc lengths."""
        counts, steps_m = self._counts[paths, None], self._steps_m[paths, None]
        along = np.asarray(arc_m, dtype=float) / steps_m
        along = np.where(self._closed[paths, None], along % counts, along)
        index = np.clip(np.floor(along).astype(int), 0, counts - 1)
        return index, along - index

    def _heading(self, segment: np.ndarray, fraction: np.ndarray) -> np.ndarray:
        return np.asarray(wrap_angle(segment[..., _HEADING] + fraction * segment[..., _TURN]))
