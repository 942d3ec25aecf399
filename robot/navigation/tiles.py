"""The tiles a road map is laid from, as written in a Duckietown map file (``curve_left/W``)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Dict, Tuple

from robot.errors import MapError, nearest

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
