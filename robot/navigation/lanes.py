"""The tiles of a road map, and the lanes through them: cubic Beziers, with traffic on the right.

The curves are those of gym-duckietown 6.1.34, so that lanes agree with its maps to rounding, with
two exceptions that follow the map files' own meaning:

* ``3way_right`` is the mirror of ``3way_left``: the side road leaves to the right. The simulator
  draws the left one for both.
* The outer lane of ``curve_right`` is the mirror of ``curve_left``'s. The simulator's bulges and
  meets the next tile 11 degrees askew (its issue 227).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Dict, NamedTuple, Sequence, Tuple

import numpy as np

from robot.errors import MapError, nearest
from robot.geometry import bezier_points, bezier_tangents

# In this order, so that the index is the number of counter-clockwise quarter turns from S.
ORIENTATIONS = ("S", "E", "N", "W")

# The sides at which a road leaves the tile, for orientation S (driving south).
ROAD_SIDES: Dict[str, str] = {
    "straight": "SN",
    "curve_left": "EN",
    "curve_right": "NW",
    "3way_left": "SEN",
    "3way_right": "SNW",
    "4way": "SENW",
}
FLOOR_KINDS = ("asphalt", "grass", "floor", "calibration_tile", "empty")
TILE_KINDS = (*ROAD_SIDES, *FLOOR_KINDS)
# (rows south, columns east) to the neighbour on each side; row 0 is the north row.
STEPS: Dict[str, Tuple[int, int]] = {"S": (1, 0), "E": (0, 1), "N": (-1, 0), "W": (0, -1)}


@dataclass(frozen=True)
class Tile:
    """One square of the grid; ``quarter_turns`` counter-clockwise from orientation S."""

    kind: str
    quarter_turns: int
    row: int  # 0 is the north row
    column: int  # 0 is the west column

    @property
    def is_road(self) -> bool:
        """Whether a robot may drive here."""
        return self.kind in ROAD_SIDES

    @property
    def is_junction(self) -> bool:
        """Whether three or four roads meet here."""
        return len(ROAD_SIDES.get(self.kind, "")) > 2

    @property
    def road_sides(self) -> Tuple[str, ...]:
        """The sides (S, E, N, W) at which a road leaves this tile; empty for floor."""
        sides = ROAD_SIDES.get(self.kind, "")
        return tuple(
            ORIENTATIONS[(ORIENTATIONS.index(side) + self.quarter_turns) % 4] for side in sides
        )


def parse_tile(text: object, row: int, column: int, where: str = "") -> Tile:
    """Read ``kind/ORIENTATION``; no "/" means east, and a bare name with a 4 means 4way/E.

    MapError names row, column and the valid kinds or orientations.
    """
    place = f"{where}: row {row}, column {column}" if where else f"row {row}, column {column}"
    if not isinstance(text, str):
        raise MapError(f"{place}: expected a tile such as straight/E, got {text!r}")
    kind, slash, orientation = (part.strip() for part in text.strip().partition("/"))
    if not slash:
        kind, orientation = ("4way" if "4" in kind else kind), "E"
    if kind not in TILE_KINDS:
        raise MapError(f"{place}: unknown tile {text!r}; {nearest(kind, TILE_KINDS)}")
    if orientation not in ORIENTATIONS:
        raise MapError(
            f"{place}: unknown orientation {orientation!r} of tile {text!r}; "
            f"valid: {', '.join(ORIENTATIONS)}"
        )
    return Tile(kind, ORIENTATIONS.index(orientation), row, column)


Curve = Tuple[Tuple[float, float], ...]
_LEFT = np.array(((0, 1), (-1, 0)))  # turns points (K, 2) @ it by a quarter, counter-clockwise
_CHORDS = 48  # per lane, to find the parameter of the nearest point

# Control points in tiles from the tile's centre, x east and y north, for orientation S.
_SOUTH: Curve = ((-0.2, 0.5), (-0.2, 0.25), (-0.2, -0.25), (-0.2, -0.5))
_NORTH: Curve = ((0.2, -0.5), (0.2, -0.25), (0.2, 0.25), (0.2, 0.5))
_SOUTH_TO_EAST: Curve = ((-0.2, 0.5), (-0.2, 0.0), (0.0, -0.2), (0.5, -0.2))
_SOUTH_TO_WEST: Curve = ((-0.2, 0.5), (-0.2, 0.2), (-0.3, 0.2), (-0.5, 0.2))

_CURVES: Dict[str, Tuple[Curve, ...]] = {
    "straight": (_SOUTH, _NORTH),
    "curve_left": (_SOUTH_TO_EAST, ((0.5, 0.2), (0.3, 0.2), (0.2, 0.3), (0.2, 0.5))),
    "curve_right": (_SOUTH_TO_WEST, ((-0.5, -0.2), (0.0, -0.2), (0.2, 0.0), (0.2, 0.5))),
    "3way_left": (
        _SOUTH,
        _SOUTH_TO_EAST,
        _NORTH,
        ((0.5, 0.2), (0.3, 0.2), (0.2, 0.2), (0.2, 0.5)),
        ((0.2, -0.5), (0.2, -0.2), (0.3, -0.2), (0.5, -0.2)),
        ((0.5, 0.2), (0.3, 0.2), (-0.2, 0.0), (-0.2, -0.5)),
    ),
    "4way": (_SOUTH_TO_EAST, _SOUTH, _SOUTH_TO_WEST),  # repeated for the four quarter turns
}


@dataclass(frozen=True, eq=False)
class Lane:
    """One lane through one tile: the control points of its centre line, in driving direction."""

    tile_row: int
    tile_column: int
    control_points_m: np.ndarray  # (4, 2), world frame


def tile_lanes(tile: Tile, tile_size_m: float, rows: int) -> Tuple[Lane, ...]:
    """The lanes through a tile of a grid of ``rows`` rows; none where the tile is no road."""
    if not tile.is_road:
        return ()
    centre = np.array([tile.column + 0.5, rows - tile.row - 0.5])
    kind, turns = tile.kind, tile.quarter_turns
    if kind == "3way_right":
        kind, turns = "3way_left", turns + 2
    every = range(4) if kind == "4way" else (turns,)
    turned = [
        np.array(curve) @ np.linalg.matrix_power(_LEFT, k) for k in every for curve in _CURVES[kind]
    ]
    return tuple(Lane(tile.row, tile.column, (curve + centre) * tile_size_m) for curve in turned)


def border_point(point_m: np.ndarray, tile_size_m: float) -> Tuple[int, int]:
    """A hashable name for the place where lanes meet: its coordinates in tenths of a tile.

    Every lane begins and ends 0.2 tiles beside the middle of a tile's side, so that rounding to
    tenths is safe. Traffic keeps right, so that lanes which meet also agree in direction.
    """
    x, y = np.rint(np.asarray(point_m) * (10.0 / tile_size_m)).astype(int).tolist()
    return x, y


class LanesNear(NamedTuple):
    """The nearest point of each of L lanes to one position."""

    distance_m: np.ndarray  # (L,) to that point, not signed
    t: np.ndarray  # (L,) its Bezier parameter
    offset_m: np.ndarray  # (L,) of the position to the left of the lane
    heading_rad: np.ndarray  # (L,) of the lane there


class LaneIndex:
    """Finds the nearest point of every one of L lanes at once, exact to less than 0.1 mm."""

    def __init__(self, lanes: Sequence[Lane]) -> None:
        self.lanes = tuple(lanes)
        self._control = np.array([lane.control_points_m for lane in lanes]).reshape(-1, 4, 2)
        t = np.linspace(0.0, 1.0, _CHORDS + 1)
        points = np.array([bezier_points(control, t) for control in self._control])
        self._starts = points.reshape(-1, _CHORDS + 1, 2)[:, :-1]
        self._chords = np.diff(points.reshape(-1, _CHORDS + 1, 2), axis=1)
        self._inverse_squares = 1.0 / (self._chords**2).sum(axis=-1)

    def near(self, x_m: float, y_m: float) -> LanesNear:
        """The nearest point of every lane to a position."""
        position = np.array([x_m, y_m])
        delta = position - self._starts
        along = np.clip((delta * self._chords).sum(-1) * self._inverse_squares, 0.0, 1.0)
        squares = ((delta - along[..., None] * self._chords) ** 2).sum(-1)
        chord = squares.argmin(axis=1)
        rows = np.arange(len(self.lanes))
        t = (chord + along[rows, chord]) / _CHORDS
        point, tangent = bezier_points(self._control, t), bezier_tangents(self._control, t)
        delta = position - point
        direction = tangent / np.linalg.norm(tangent, axis=-1, keepdims=True)
        return LanesNear(
            np.hypot(delta[:, 0], delta[:, 1]),
            t,
            direction[:, 0] * delta[:, 1] - direction[:, 1] * delta[:, 0],
            np.arctan2(direction[:, 1], direction[:, 0]),
        )
