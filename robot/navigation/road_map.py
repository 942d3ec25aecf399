"""Road maps: Duckietown map files read as they are, in our world frame.

The world's origin is the south-west corner of the grid, x east, y north, metres. In the files rows
count from the north; the simulator's frame has z pointing south: y = rows * tile_size - z.

Lanes are cubic Beziers, with traffic on the right: those of gym-duckietown 6.1.34 to rounding, with
two exceptions that follow the map files' own meaning:

* ``3way_right`` is the mirror of ``3way_left``: the side road leaves to the right. The simulator
  draws the left one for both.
* The outer lane of ``curve_right`` is the mirror of ``curve_left``'s. The simulator's bulges and
  meets the next tile 11 degrees askew (its issue 227).
"""

import math
import sys
from dataclasses import dataclass, field
from functools import cached_property
from itertools import chain
from pathlib import Path
from typing import Any, Dict, List, NamedTuple, Optional, Sequence, Tuple, Union

import numpy as np

from robot.errors import ConfigError, MapError, nearest
from robot.geometry import Pose, bezier_points, bezier_tangents
from robot.typed_config import read_yaml

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
        numbers = map(ORIENTATIONS.index, ROAD_SIDES.get(self.kind, ""))
        return tuple(ORIENTATIONS[(number + self.quarter_turns) % 4] for number in numbers)


def parse_tile(text: object, row: int, column: int, where: str = "") -> Tile:
    """Read ``kind/ORIENTATION``; no "/" means east, a bare name with a 4 4way/E. MapError: else."""
    place = f"{where}: row {row}, column {column}" if where else f"row {row}, column {column}"
    if not isinstance(text, str):
        raise MapError(f"{place}: expected a tile such as straight/E, got {text!r}")
    kind, slash, orientation = (part.strip() for part in text.strip().partition("/"))
    if not slash:
        kind, orientation = ("4way" if "4" in kind else kind), "E"
    if kind not in TILE_KINDS:
        raise MapError(f"{place}: unknown tile {text!r}; {nearest(kind, TILE_KINDS)}")
    if orientation not in ORIENTATIONS:
        told = nearest(orientation, ORIENTATIONS)
        raise MapError(f"{place}: unknown orientation {orientation!r} of tile {text!r}; {told}")
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

    tile: Tile
    control_points_m: np.ndarray  # (4, 2), world frame

    def pose_at(self, t: float) -> Pose:
        """On its middle, at a parameter of the Bezier, 0 to 1."""
        (at,) = bezier_points(self.control_points_m, np.array([t]))
        (ahead,) = bezier_tangents(self.control_points_m, np.array([t]))
        return Pose(float(at[0]), float(at[1]), math.atan2(ahead[1], ahead[0]))


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
    return tuple(Lane(tile, (curve + centre) * tile_size_m) for curve in turned)


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
        self._control = np.array([lane.control_points_m for lane in lanes]).reshape(-1, 4, 2)
        points = bezier_points(self._control[:, None], np.linspace(0.0, 1.0, _CHORDS + 1))
        self._starts, self._chords = points[:, :-1], np.diff(points, axis=1)
        self._inverse_squares = 1.0 / (self._chords**2).sum(axis=-1)

    def near(self, x_m: float, y_m: float) -> LanesNear:
        """The nearest point of every lane to a position."""
        position = np.array([x_m, y_m])
        delta = position - self._starts
        along = np.clip((delta * self._chords).sum(-1) * self._inverse_squares, 0.0, 1.0)
        chord = ((delta - along[..., None] * self._chords) ** 2).sum(-1).argmin(axis=1)
        t = (chord + along[np.arange(len(self._control)), chord]) / _CHORDS
        point, tangent = bezier_points(self._control, t), bezier_tangents(self._control, t)
        delta = position - point
        direction = tangent / np.linalg.norm(tangent, axis=-1, keepdims=True)
        offset_m = direction[:, 0] * delta[:, 1] - direction[:, 1] * delta[:, 0]
        heading_rad = np.arctan2(direction[:, 1], direction[:, 0])
        return LanesNear(np.hypot(delta[:, 0], delta[:, 1]), t, offset_m, heading_rad)


MAPS_FOLDER = Path(__file__).parent.parent / "maps"
_KEYS = ("tiles", "tile_size", "objects", "start_tile", "start_pose", "version")


@dataclass(frozen=True)
class RoadMap:
    """A grid of tiles; `robot.navigation.map_objects` reads its ``objects``, as in the file."""

    name: str
    tile_size_m: float
    tiles: Tuple[Tuple[Tile, ...], ...]  # rows from north to south
    objects: Any = field(default=None, repr=False, compare=False)

    @property
    def rows(self) -> int:
        """Number of rows of tiles."""
        return len(self.tiles)

    @property
    def columns(self) -> int:
        """Number of columns of tiles."""
        return len(self.tiles[0])

    @property
    def width_m(self) -> float:
        """Extent along x [m]."""
        return self.columns * self.tile_size_m

    @property
    def height_m(self) -> float:
        """Extent along y [m]."""
        return self.rows * self.tile_size_m

    @cached_property
    def road_tiles(self) -> Tuple[Tile, ...]:
        """The tiles a robot may drive on, row by row from the north-west."""
        return tuple(tile for row in self.tiles for tile in row if tile.is_road)

    @cached_property
    def lanes(self) -> Tuple[Lane, ...]:
        """Every lane of every road tile, row by row from the north-west."""
        every = (tile_lanes(tile, self.tile_size_m, self.rows) for tile in self.road_tiles)
        return tuple(chain.from_iterable(every))

    @cached_property
    def lane_index(self) -> LaneIndex:
        """Finds the nearest points of all ``lanes``."""
        return LaneIndex(self.lanes)

    def tile_at(self, x_m: float, y_m: float) -> Optional[Tile]:
        """The tile under a point of the world; None beyond the grid."""
        if not (0.0 <= x_m < self.width_m and 0.0 <= y_m < self.height_m):
            return None
        column = min(int(x_m / self.tile_size_m), self.columns - 1)
        return self.tiles[max(self.rows - 1 - int(y_m / self.tile_size_m), 0)][column]

    def beyond(self, tile: Tile, side: str) -> Optional[Tile]:
        """The tile next to another on one side (S, E, N, W); None beyond the grid."""
        row, column = tile.row + STEPS[side][0], tile.column + STEPS[side][1]
        inside = 0 <= row < self.rows and 0 <= column < self.columns
        return self.tiles[row][column] if inside else None

    def on_road(self, x_m: float, y_m: float) -> bool:
        """Whether a point of the world lies on a road tile."""
        tile = self.tile_at(x_m, y_m)
        return tile is not None and tile.is_road


def shipped_maps() -> Dict[str, Path]:
    """The maps that come with this package, by name; one in a folder as ``rings/bean``."""
    files = sorted(MAPS_FOLDER.rglob("*.yaml"))
    return {path.relative_to(MAPS_FOLDER).with_suffix("").as_posix(): path for path in files}


def load_map(source: Union[str, Path]) -> RoadMap:
    """Read a Duckietown map: a YAML file, or the name of a shipped map (loop, arena, town).

    A map without road (a calibration board, say) loads; what needs a road then says so. Where the
    reference simulator would start (``start_tile``, ``start_pose``) means nothing here. MapError
    for what cannot be read, with row, column and valid choices.
    """
    shipped = shipped_maps()
    path = shipped.get(str(source), Path(source))
    if not path.is_file():
        told = nearest(path.stem, shipped)
        raise MapError(f"{source}: expected a map file or a shipped map; {told}")
    try:
        data = read_yaml(path)
    except ConfigError as error:
        raise MapError(str(error)) from error
    return read_map(data, path.stem)


def read_map(data: Any, name: str) -> RoadMap:
    """A map from the plain data of its YAML file; see `load_map`."""
    if not isinstance(data, dict):
        raise MapError(f"{name}: expected a mapping with tiles and tile_size, got {data!r}")
    refuse_misspelt_keys(data, _KEYS, name)
    if "tile_size" not in data:
        raise MapError(f"{name}: tile_size is missing; add its edge in metres, as tile_size: 0.585")
    tile_size_m = number(data["tile_size"], f"{name}: tile_size")
    if not 0.0 < tile_size_m <= 5.0:
        raise MapError(f"{name}: tile_size: expected above 0 m, at most 5 m, got {tile_size_m}")
    rows = data.get("tiles")
    if not isinstance(rows, list) or not rows:
        raise MapError(f"{name}: tiles: expected a list of rows of tiles, got {rows!r}")
    tiles: List[Tuple[Tile, ...]] = []
    for i, row in enumerate(rows):
        if not isinstance(row, list) or not row:
            raise MapError(f"{name}: row {i}: expected a list of tiles, got {row!r}")
        if len(row) != len(rows[0]):
            told = f"expected {len(rows[0])} tiles as in row 0, got {len(row)}"
            raise MapError(f"{name}: row {i}: {told}")
        tiles.append(tuple(parse_tile(text, i, j, name) for j, text in enumerate(row)))
    return RoadMap(name, tile_size_m, tuple(tiles), data.get("objects"))


_MOST = sys.float_info.max


def number(value: Any, where: str) -> float:
    """A finite number as float; MapError otherwise."""
    if isinstance(value, (int, float)) and not isinstance(value, bool) and abs(value) <= _MOST:
        return float(value)
    raise MapError(f"{where}: expected a number, got {value!r}")


def numbers(value: Any, count: int, where: str) -> List[float]:
    """A list of ``count`` finite numbers; MapError otherwise."""
    if not isinstance(value, (list, tuple)) or len(value) != count:
        raise MapError(f"{where}: expected {count} numbers, got {value!r}")
    return [number(item, where) for item in value]


def refuse_misspelt_keys(entry: Dict[Any, Any], known: Tuple[str, ...], where: str) -> None:
    """Refuse a key that is nearly a known one; other unknown keys are some other tool's."""
    for key in entry:
        if key not in known and nearest(str(key), known).startswith("did you mean"):
            raise MapError(f"{where}: unknown key {key!r}; {nearest(str(key), known)}")
