"""Photographs that a person annotated: acceptable actions, and where the lines lie.

``photographs.yaml`` holds file names, letters for actions and points of lines; the photographs lie
elsewhere; docs/photographs.md has the rule. Where a line lies on the floor depends on lens and
mounting, which nobody measured: the nominal ones are assumed (three calibrated robots are within
3 % of them).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from robot.camera.files import read_picture
from robot.camera.source import fit_to_frame
from robot.errors import ConfigError
from robot.lens import CameraRig
from robot.typed_config import load_yaml
from trainer.judging.yellow_line import (
    DASHES,
    RANGE_M,
    Dash,
    YellowLine,
    fit_line,
)

FILE = Path(__file__).with_name("photographs.yaml")
_SPACING_M = 0.075  # a dash and a gap of Duckietown's yellow tape

# Lines between these distances may be found or not; the detector's range lies between them.
SURELY_NEAR_M, SURELY_FAR_M = 0.9 * RANGE_M, 1.1 * RANGE_M
TOO_CLOSE_M = 0.01  # to the line: no side can be told

Polyline = tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class Annotated:
    """One photograph."""

    file: str
    actions: str = ""  # of each action s(ensible), a(rguable) or w(rong); none: nobody can tell
    yellow: tuple[Polyline, ...] = ()  # every yellow line, from near to far [px]
    white: Polyline = ()  # the line to the right of the robot's lane [px]


@dataclass(frozen=True)
class Site:
    """Photographs of one place."""

    name: str
    folder: str
    photographs: tuple[Annotated, ...]


@dataclass(frozen=True)
class Annotations:
    """``photographs.yaml``."""

    size: tuple[int, int]  # width, height that the points count in
    sites: tuple[Site, ...]


class DrawnLine(NamedTuple):
    """A drawn line on the floor, robot frame."""

    nearest_m: float  # its point nearest to the axle
    line: YellowLine


def load_annotations() -> Annotations:
    """Those that come with the project."""
    return load_yaml(Annotations, FILE)


def frames_of(site: Site, photographs: Path) -> Iterator[tuple[Annotated, np.ndarray]]:
    """Each annotated photograph with its frame (120, 160, 3) uint8 RGB.

    Args:
        site: the place.
        photographs: the folder that holds the sites' folders.

    Raises:
        ConfigError: a photograph is missing.
    """
    for drawn in site.photographs:
        path = photographs / site.folder / "images" / drawn.file
        if not path.is_file():
            raise ConfigError(f"{path}: expected an annotated photograph, found none")
        yield drawn, fit_to_frame(read_picture(path))


def on_floor(points: Polyline, size: tuple[int, int], rig: CameraRig) -> np.ndarray:
    """(M, 2) [m], robot frame: where drawn points lie; those above the horizon are left out."""
    scaled = CameraRig(rig.lens.scaled(*size), rig.mount)
    floor = scaled.to_floor(np.asarray(points, dtype=float) - 0.5)
    return np.asarray(floor[np.isfinite(floor).all(axis=1)])


def drawn_line(
    points: Polyline, size: tuple[int, int], rig: CameraRig, reference_m: float
) -> DrawnLine | None:
    """The line as the detector would have it, had it seen what the person drew.

    Args:
        points: drawn through the middle of the line, from near to far [px].
        size: width, height that they count in.
        rig: the camera that is assumed.
        reference_m: how far ahead of the axle the point lies that is judged [m].

    Returns:
        None where less than two points lie on the floor.
    """
    floor = on_floor(points, size, rig)
    if len(floor) < 2:
        return None
    arc = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(floor, axis=0).T))))
    ways = np.arange(0.0, arc[-1], _SPACING_M)
    dense = np.stack([np.interp(ways, arc, floor[:, k]) for k in (0, 1)], axis=1)
    near = dense[np.hypot(*dense.T) < RANGE_M][:DASHES]
    chosen = near if len(near) > 1 else floor[:2]
    step = chosen[1] - chosen[0]
    direction = math.atan(step[1] / step[0]) if step[0] else math.pi / 2
    dashes = tuple(Dash(float(x), float(y), direction, 0.05, 0.025, 9) for x, y in chosen)
    nearest_m = float(np.hypot(*floor.T).min())
    return DrawnLine(nearest_m, fit_line(dashes, reference_m))


def agrees(found: YellowLine, drawn: Sequence[DrawnLine]) -> bool | None:
    """Whether what was found of a line is what a person drew, on its side; None: nobody can say."""
    nearest_m = min((each.nearest_m for each in drawn), default=np.inf)
    if SURELY_NEAR_M <= nearest_m < SURELY_FAR_M:
        return None
    near = nearest_m < SURELY_NEAR_M
    if not (found.found and near):
        return found.found == near
    sides_m = [each.line.offset_m for each in drawn if each.nearest_m < SURELY_FAR_M]
    if min(abs(side_m) for side_m in sides_m) < TOO_CLOSE_M:
        return None
    return any((side_m > 0.0) == found.crossed for side_m in sides_m)
