"""Road maps: Duckietown map files read as they are, in our world frame.

The world's origin is the south-west corner of the grid, x east, y north, metres. In the files rows
count from the north; the simulator's frame has z pointing south: y = rows * tile_size - z.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Dict, List, Optional, Tuple, Union

from robot.errors import ConfigError, MapError, nearest
from robot.navigation.lanes import STEPS, Lane, LaneIndex, Tile, parse_tile, tile_lanes
from robot.typed_config import read_yaml

MAPS_FOLDER = Path(__file__).parent.parent / "maps"
_KEYS = ("tiles", "tile_size", "objects", "start_tile", "start_pose", "version")


@dataclass(frozen=True)
class RoadMap:
    """A grid of tiles.

    ``objects`` is what the file says of things on and beside the road, as it stands there; see
    `robot.navigation.map_objects`.
    """

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
        return tuple(
            lane
            for tile in self.road_tiles
            for lane in tile_lanes(tile, self.tile_size_m, self.rows)
        )

    @cached_property
    def lane_index(self) -> LaneIndex:
        """Finds the nearest points of all ``lanes``."""
        return LaneIndex(self.lanes)

    def tile_at(self, x_m: float, y_m: float) -> Optional[Tile]:
        """The tile under a point of the world; None beyond the grid."""
        if not (0.0 <= x_m < self.width_m and 0.0 <= y_m < self.height_m):
            return None
        column = min(int(x_m / self.tile_size_m), self.columns - 1)
        row = max(self.rows - 1 - int(y_m / self.tile_size_m), 0)
        return self.tiles[row][column]

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
        raise MapError(
            f"{source}: expected a map file or a shipped map; {nearest(path.stem, shipped)}"
        )
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
    if tile_size_m <= 0.0:
        raise MapError(f"{name}: tile_size: expected a length above 0 m, got {tile_size_m}")
    rows = data.get("tiles")
    if not isinstance(rows, list) or not rows:
        raise MapError(f"{name}: tiles: expected a list of rows of tiles, got {rows!r}")
    for i, row in enumerate(rows):
        if not isinstance(row, list) or not row:
            raise MapError(f"{name}: row {i}: expected a list of tiles, got {row!r}")
        if len(row) != len(rows[0]):
            raise MapError(
                f"{name}: row {i}: expected {len(rows[0])} tiles as in row 0, got {len(row)}"
            )
    tiles = tuple(
        tuple(parse_tile(text, i, j, name) for j, text in enumerate(row))
        for i, row in enumerate(rows)
    )
    return RoadMap(name, tile_size_m, tiles, data.get("objects"))


def number(value: Any, where: str) -> float:
    """A finite number as float; MapError otherwise."""
    try:
        if not isinstance(value, bool) and isinstance(value, (int, float)) and math.isfinite(value):
            return float(value)
    except OverflowError:  # an int beyond any float
        pass
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
