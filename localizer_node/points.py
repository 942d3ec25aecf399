"""The file of known points that a person writes for ``calibrate``.

points:
- {u_px: 208.5, v_px: 644.0, x_m: 0.0, y_m: 0.0}   # seen at this pixel
- {tag: 300, x_m: 0.1, y_m: 0.1}                   # AprilTag 36h11 flat on the floor, its middle
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import List, Optional, Sequence, Tuple, Union

import numpy as np

from localizer_node.calibrate import (
    KnownPoint,
    map_corners,
)
from localizer_node.tags import Tag, TagReader
from robot.errors import ConfigError
from robot.typed_config import load_yaml


@dataclass(frozen=True)
class FloorTag:
    """A tag of the 36h11 family flat on the floor, its middle at this place."""

    tag: int
    x_m: float
    y_m: float


@dataclass(frozen=True)
class PointsFile:
    """Points of the floor, and how the picture shows them."""

    points: Tuple[Union[KnownPoint, FloorTag], ...]


def read_points(path: Union[str, Path], image: Optional[np.ndarray]) -> List[KnownPoint]:
    """The points of a file; tags are looked for in the RGB picture (H, W, 3).

    Raises:
        ConfigError: the file does not fit, or a tag is not in the picture.
    """
    entries = load_yaml(PointsFile, path).points
    wanted = [e for e in entries if isinstance(e, FloorTag)]
    points = [e for e in entries if isinstance(e, KnownPoint)]
    if not wanted:
        return points
    if image is None:
        raise ConfigError(f"{path}: has floor tags; expected --image, a picture that shows them")
    return points + [_seen(tag, TagReader().read(image)) for tag in wanted]


def _seen(wanted: FloorTag, tags: Sequence[Tag]) -> KnownPoint:
    for tag in tags:
        if tag.number == wanted.tag:
            u, v = _crossing(tag.corners_px)
            return KnownPoint(u, v, wanted.x_m, wanted.y_m)
    seen = ", ".join(str(t.number) for t in tags) or "none"
    raise ConfigError(
        f"floor tag {wanted.tag}: not found in the picture (seen: {seen}); expected it flat on the "
        "floor, lit evenly, at least 24 px wide and with its white margin"
    )


def _crossing(corners: np.ndarray) -> Tuple[float, float]:
    """Where the diagonals meet: the image of the middle, whatever the perspective."""
    a, b, c, d = np.column_stack((corners, np.ones(4)))
    point = np.cross(np.cross(a, c), np.cross(b, d))
    return float(point[0] / point[2]), float(point[1] / point[2])


def corner_points(
    pixels: Sequence[Tuple[float, float]], map_size_m: Tuple[float, float]
) -> List[KnownPoint]:
    """The map's corners, given as south-west, south-east, north-east, north-west.

    Raises:
        ConfigError: not four of them.
    """
    if len(pixels) != 4:
        raise ConfigError(
            "expected four --corner U,V (south-west, south-east, north-east, north-west), "
            f"got {len(pixels)}"
        )
    corners = map_corners(map_size_m)
    return [KnownPoint(u, v, float(x), float(y)) for (u, v), (x, y) in zip(pixels, corners)]
