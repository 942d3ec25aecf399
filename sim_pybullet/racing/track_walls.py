"""The walls along a race track as boxes."""

from __future__ import annotations

import math

import numpy as np

from sim_pybullet.classes import SemanticClass
from sim_pybullet.look import Look
from sim_pybullet.racing.track import SCALE, CentreLine, Track, centre_line
from sim_pybullet.scene import Solid

THICK_M = 0.6  # of the real track, as what follows
SAG_M = 0.15  # a wall piece is at most so far from the curve that it follows
SHORTEST_M, LONGEST_M = 3, 20  # pieces; centre lines have a point every metre
_CLEAR_M = 0.3  # walls nearer than this to the edge of another part of the track are left out


def track_walls(track: Track, look: Look) -> tuple[Solid, ...]:
    """Both walls, in pieces of two colours by turns; none where the track runs by itself."""
    line = centre_line(track)
    ends = _pieces(line)
    solids: list[Solid] = []
    for side in (1.0, -1.0):
        solids += _wall(line, ends, side, look)
    return tuple(solids)


def _pieces(line: CentreLine) -> np.ndarray:
    """Indices of the centre line's points at which pieces begin, and the first again."""
    bend = np.abs(line.curvature) * SCALE
    begins, count = [0], len(bend)
    while begins[-1] < count:
        ahead = bend[begins[-1] : begins[-1] + LONGEST_M].max()
        most = math.sqrt(8.0 * SAG_M / ahead) if ahead > 0.0 else LONGEST_M
        begins.append(begins[-1] + int(min(max(most, SHORTEST_M), LONGEST_M)))
    begins[-1] = count
    return np.array(begins) % count


def _wall(line: CentreLine, ends: np.ndarray, side: float, look: Look) -> list[Solid]:
    away_m = line.half_width_m + line.verge_m
    corners = _beside(line, ends, side * (away_m + 0.5 * THICK_M * SCALE))
    middles, along = 0.5 * (corners[1:] + corners[:-1]), np.diff(corners, axis=0)
    points = line.path.points_m
    nearest = np.array([np.hypot(*(points - middle).T).min() for middle in middles])
    headings = line.path.headings_rad[ends[:-1]]
    forward = along[:, 0] * np.cos(headings) + along[:, 1] * np.sin(headings)
    kept = (nearest > away_m - _CLEAR_M * SCALE) & (forward > 0.0)
    colours = (look.track.wall_rgb, look.track.wall_2_rgb)
    return [
        Solid(
            "box",
            float(middles[k, 0]),
            float(middles[k, 1]),
            math.atan2(along[k, 1], along[k, 0]),
            (math.hypot(*along[k]), THICK_M * SCALE, look.track.wall_height_m * SCALE),
            colours[k % 2],
            SemanticClass.WALL,
        )
        for k in np.flatnonzero(kept).tolist()
    ]


def _beside(line: CentreLine, index: np.ndarray, offset_m: float) -> np.ndarray:
    """Points (K, 2) beside the centre line's points, to the left where ``offset_m`` is positive."""
    headings = line.path.headings_rad[index]
    left = np.stack((-np.sin(headings), np.cos(headings)), axis=1)
    return np.asarray(line.path.points_m[index] + offset_m * left)
