"""``Calibration``: all that turns a pixel of the overhead camera into a place on the floor.

Pixels are (u, v) of the raw picture, u right, v down, (0, 0) the centre of the top-left pixel.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Dict, Tuple, Union

from robot.errors import ConfigError, nearest
from robot.lens import Lens
from robot.output import write_text
from robot.typed_config import load_yaml, to_plain

KINDS = ("two_colour", "tag", "plain")
Point = Tuple[float, float]


@dataclass(frozen=True)
class Colour:
    """A named box in HSV; hue in degrees, wrapping when min > max; the rest in 0..1."""

    name: str
    hue_min_deg: float
    hue_max_deg: float
    saturation_min: float = 0.4
    value_min: float = 0.18

    def __post_init__(self) -> None:
        hues = (self.hue_min_deg, self.hue_max_deg)
        parts = (self.saturation_min, self.value_min)
        if not (all(0 <= h <= 360 for h in hues) and all(0 <= p <= 1 for p in parts)):
            raise ConfigError(f"colour {self.name!r}: expected hues 0..360, rest 0..1, got {self}")


DEFAULT_COLOURS = (
    Colour("blue", 200.0, 250.0),
    Colour("green", 95.0, 165.0, 0.35),
    Colour("magenta", 285.0, 335.0),
    Colour("orange", 10.0, 36.0, 0.55, 0.4),
)


@dataclass(frozen=True)
class Board:
    """The blue sheet on a robot's back, flat at ``height_m`` above the floor, length along x."""

    length_m: float = 0.16
    width_m: float = 0.14
    height_m: float = 0.12
    front_m: float = 0.06  # of the length, the stripe in front in the second colour (two_colour)
    forward_m: float = 0.0  # of the board's centre, ahead of the wheel axle
    tag_m: float = 0.09  # side of the tag's black square (tag)

    def __post_init__(self) -> None:
        if not min(self.length_m, self.width_m) > 0:
            raise ConfigError(f"board: expected positive length_m and width_m, got {self}")
        if self.height_m < 0:
            raise ConfigError(f"board: expected height_m >= 0, got {self.height_m}")


@dataclass(frozen=True)
class Marker:
    """What tells one robot from the others, and where its front is.

    ``two_colour``: blue rear, front stripe in the colour named ``front``. ``tag``: AprilTag 36h11
    number ``tag`` on the blue board, its upper edge to the front. ``plain``: blue only, without a
    front; any blue board looks like it, so it has to be the only robot.
    """

    robot: str = "robot"
    kind: str = "two_colour"
    front: str = "green"
    tag: int = 0
    board: Board = Board()

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise ConfigError(f"marker kind: unknown {self.kind!r}; {nearest(self.kind, KINDS)}")
        board = self.board
        if self.kind == "two_colour" and not 0.0 < board.front_m < board.length_m:
            raise ConfigError(f"board: expected 0 < front_m < length_m, got {board}")
        if self.kind == "tag" and not 0.0 < 1.25 * board.tag_m <= min(self.blue_m):
            raise ConfigError(f"board: expected the tag and its white margin on it, got {board}")

    @property
    def identity(self) -> Tuple[str, str]:
        """Equal for markers that the camera cannot tell apart."""
        return (self.kind, {"two_colour": self.front, "tag": str(self.tag), "plain": ""}[self.kind])

    @property
    def blue_m(self) -> Tuple[float, float]:
        """(length, width) of the blue part [m]."""
        stripe = self.board.front_m if self.kind == "two_colour" else 0.0
        return self.board.length_m - stripe, self.board.width_m


@dataclass(frozen=True)
class Calibration:
    """Lens, place of the camera, arena and robots of one installation.

    The chain from pixel to floor: region of interest -> ``lens`` (undistort) -> turn by
    ``rotation_rad`` (about the optical axis, clockwise in the picture, so that north is up) ->
    ``homography`` -> floor [m]. ``camera_m`` corrects for the height of a marker (rectify.py).
    """

    lens: Lens
    homography: Tuple[float, ...]  # row-major (3, 3): turned plane at depth 1 -> floor [m]
    camera_m: Tuple[float, float, float]  # x, y, height above the floor
    rotation_rad: float = 0.0
    roi_px: Tuple[Point, ...] = ()  # polygon; empty means the whole picture
    map_size_m: Point = (2.2, 2.64)  # of the road map: east-west, north-south
    colours: Tuple[Colour, ...] = DEFAULT_COLOURS
    board_colour: str = "blue"
    robots: Tuple[Marker, ...] = (Marker(),)
    residual_mm: float = float("nan")  # RMS over the points it was made from

    def __post_init__(self) -> None:
        if len(self.homography) != 9:
            raise ConfigError(f"homography: expected 9 numbers, got {len(self.homography)}")
        if len(self.roi_px) in (1, 2):
            raise ConfigError(f"roi_px: expected none or at least 3 corners, got {self.roi_px}")
        self._check_robots()

    def _check_robots(self) -> None:
        for name in (self.board_colour, *(r.front for r in self.robots if r.kind == "two_colour")):
            self.colour(name)
        plain = [m.robot for m in self.robots if m.kind == "plain"]
        if plain and len(self.robots) > 1:
            raise ConfigError(
                f"robot {plain[0]!r} is plain and any blue board looks like it; expected it alone, "
                f"got {len(self.robots)} robots: give each a tag or a front colour"
            )
        seen: Dict[object, str] = {}
        for marker in self.robots:
            if marker.board.height_m >= self.camera_m[2]:
                raise ConfigError(
                    f"robot {marker.robot!r}: board at {marker.board.height_m} m, but the camera "
                    f"hangs at {self.camera_m[2]} m; expected the camera above the board"
                )
            for key in (marker.robot, marker.identity):
                if key in seen:
                    raise ConfigError(
                        f"robots {seen[key]!r} and {marker.robot!r} cannot be told apart ({key}); "
                        "give each its own name and its own tag or front colour"
                    )
                seen[key] = marker.robot

    def colour(self, name: str) -> Colour:
        """The colour of this name; ConfigError with the nearest name when there is none."""
        for colour in self.colours:
            if colour.name == name:
                return colour
        raise ConfigError(f"colour {name!r}: {nearest(name, [c.name for c in self.colours])}")


def load_calibration(path: Union[str, Path]) -> Calibration:
    """Read what ``save_calibration`` wrote.

    ConfigError: absent, not YAML, or not a calibration, naming the key.
    """
    return load_yaml(Calibration, path)


def save_calibration(calibration: Calibration, path: Union[str, Path]) -> None:
    """Write YAML, whole or not at all."""
    import yaml

    write_text(Path(path), yaml.safe_dump(to_plain(calibration), sort_keys=False))
