"""``Calibration``: turns a pixel of the overhead camera into a place on the floor, and back.

Pixels are (u, v) of the raw picture, u right, v down, (0, 0) the centre of the top-left pixel.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Dict, Literal, Optional, Tuple

import numpy as np

from robot.errors import ConfigError, expect_between, nearest
from robot.lens import CameraRig, Hanging, Lens
from robot.link.messages import MAX_ROBOTS
from robot.link.wire import NAME

Kind = Literal["two_colour", "tag", "plain"]
Point = Tuple[float, float]
MOST_TAG = 586  # of the family 36h11


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
        figures = vars(self).values()
        if not (min(self.length_m, self.width_m) > 0 <= self.height_m and max(figures) <= 5):
            told = "expected positive length_m and width_m, height_m >= 0, all at most 5 m"
            raise ConfigError(f"board: {told}, got {self}")


@dataclass(frozen=True)
class Marker:
    """What tells one robot from the others, and where its front is.

    ``two_colour``: blue rear, front stripe in the colour named ``front``. ``tag``: AprilTag 36h11
    number ``tag`` on the blue board, its upper edge to the front. ``plain``: blue only, without a
    front; any blue board looks like it, so it has to be the only robot.
    """

    robot: str = "robot"
    kind: Kind = "two_colour"
    front: str = "green"
    tag: int = 0
    board: Board = Board()

    def __post_init__(self) -> None:
        board = self.board
        NAME["name"]("robot", self.robot)
        expect_between("tag", self.tag, 0, MOST_TAG)
        if self.kind == "two_colour" and not 0.0 < board.front_m < board.length_m:
            raise ConfigError(f"board: expected 0 < front_m < length_m, got {board}")
        if self.kind == "tag" and not 0.0 < 1.25 * board.tag_m <= min(self.blue_m):
            raise ConfigError(f"board: expected the tag and its white margin on it, got {board}")

    @property
    def blue_m(self) -> Tuple[float, float]:
        """(length, width) of the blue part [m]."""
        stripe = self.board.front_m if self.kind == "two_colour" else 0.0
        return self.board.length_m - stripe, self.board.width_m


@dataclass(frozen=True)
class Calibration:
    """Lens, place of the camera, arena and robots of one installation.

    A pixel of the region of interest is a ray through the lens, which meets the floor, or a board
    above it, at one place: so the picture is rotated, rectified and brought to the map's scale.
    """

    lens: Lens
    hanging: Hanging  # over the map
    roi_px: Tuple[Point, ...] = ()  # polygon; empty means the whole picture
    map_size_m: Point = (2.2, 2.64)  # of the road map: east-west, north-south
    colours: Tuple[Colour, ...] = DEFAULT_COLOURS
    board_colour: str = "blue"
    robots: Tuple[Marker, ...] = (Marker(),)
    residual_mm: Optional[float] = None  # RMS over the points it was made from

    def __post_init__(self) -> None:
        expect_between("number of robots", len(self.robots), 0, MAX_ROBOTS)
        expect_between("hanging.position_m: height", self.hanging.position_m[2], 0.1, 20.0)
        if len(self.roi_px) in (1, 2):
            raise ConfigError(f"roi_px: expected none or at least 3 corners, got {self.roi_px}")
        for name in (self.board_colour, *(r.front for r in self.robots if r.kind == "two_colour")):
            self.colour(name)
        plain = [m.robot for m in self.robots if m.kind == "plain"]
        if plain and len(self.robots) > 1:
            raise ConfigError(
                f"robot {plain[0]!r} is plain and any blue board looks like it; expected it alone, "
                f"got {len(self.robots)} robots: give each a tag or a front colour"
            )
        seen: Dict[object, str] = {("two_colour", self.board_colour): "the boards' own colour"}
        for marker in self.robots:
            above_m = self.hanging.position_m[2]
            if marker.board.height_m >= above_m:
                raise ConfigError(
                    f"robot {marker.robot!r}: board at {marker.board.height_m} m, but the camera "
                    f"hangs at {above_m} m; expected the camera above the board"
                )
            mark = {"two_colour": marker.front, "tag": str(marker.tag), "plain": ""}[marker.kind]
            for key in (marker.robot, (marker.kind, mark)):  # what the camera tells apart
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

    @cached_property
    def camera(self) -> CameraRig:
        """The lens where it hangs: its ``to_floor`` tells the places of pixels."""
        return CameraRig(self.lens, self.hanging)

    def to_pixels(self, points_m: np.ndarray, height_m: float = 0.0) -> np.ndarray:
        """Where floor points (..., 2), raised to ``height_m``, appear in the raw picture."""
        raised = np.full((*np.shape(points_m)[:-1], 1), height_m)
        return self.camera.to_pixels(np.concatenate((points_m, raised), axis=-1))

    def linearised(self, pixels: np.ndarray, height_m: float = 0.0) -> Tuple[np.ndarray, ...]:
        """Floor (..., 2) and its derivative (..., 2, 2) [m/px]: rows x, y, columns u, v."""
        pixels = np.asarray(pixels, dtype=float)
        steps = np.array([[0.0, 0.0], [0.5, 0.0], [-0.5, 0.0], [0.0, 0.5], [0.0, -0.5]])
        floor = self.camera.to_floor(pixels[..., None, :] + steps, height_m)
        along_u = floor[..., 1, :] - floor[..., 2, :]
        return floor[..., 0, :], np.stack((along_u, floor[..., 3, :] - floor[..., 4, :]), axis=-1)

    def roi_rect(self) -> Tuple[int, int, int, int]:
        """The slice of the picture around the region of interest: u0, v0, and u1, v1 outside."""
        last = (self.lens.width_px - 1, self.lens.height_px - 1)
        corners = np.clip(self.roi_px or ((0, 0), last), 0, last)
        u0, v0 = np.floor(corners.min(axis=0)).astype(int).tolist()
        u1, v1 = np.ceil(corners.max(axis=0)).astype(int).tolist()
        return u0, v0, u1 + 1, v1 + 1


def map_corners(map_size_m: Point) -> np.ndarray:
    """(4, 2) [m]: south-west, south-east, north-east, north-west."""
    return np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]) * np.array(map_size_m)


def map_outline(map_size_m: Point, points_per_side: int = 12) -> np.ndarray:
    """The map's edge as a closed ring of points (4 * points_per_side, 2) [m]."""
    t = np.linspace(0.0, 1.0, points_per_side, endpoint=False)[:, None]
    corners = map_corners(map_size_m)
    return np.concatenate([a + (b - a) * t for a, b in zip(corners, np.roll(corners, -1, axis=0))])
