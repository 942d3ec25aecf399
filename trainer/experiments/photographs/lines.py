"""Lines that a person drew on photographs, and what they say of where the robot stood.

`lines.yaml` holds coordinates only; the photographs lie elsewhere. What follows for a robot depends
on its lens and mounting, which nobody measured: the nominal ones are assumed (three calibrated
robots are within 3 % of them), but for photographs with another horizon.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from robot.camera.replay import read_picture
from robot.camera.source import fit_to_frame
from robot.errors import ConfigError
from robot.lens import CameraRig
from robot.typed_config import load_yaml
from trainer.judging.yellow_dashes import DEFAULT, Dash
from trainer.judging.yellow_line import YellowLine, fit_line

LINES_FILE = Path(__file__).with_name("lines.yaml")
_SPACING_M = 0.075  # a dash and a gap of Duckietown's yellow tape

Polyline = tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class Drawn:
    """One photograph."""

    file: str
    yellow: tuple[Polyline, ...] = ()  # every yellow line, from near to far [px]
    white: Polyline = ()  # the line to the right of the robot, where it is straight [px]


@dataclass(frozen=True)
class Site:
    """Photographs of one place."""

    name: str
    folder: str
    photographs: tuple[Drawn, ...]


@dataclass(frozen=True)
class Lines:
    """``lines.yaml``."""

    size: tuple[int, int]  # width, height that the points count in
    sites: tuple[Site, ...]


class DrawnLine(NamedTuple):
    """A drawn line on the floor, robot frame."""

    nearest_m: float  # its point nearest to the axle
    line: YellowLine


def load_lines() -> Lines:
    """The lines that come with the project."""
    return load_yaml(Lines, LINES_FILE)


def frames_of(site: Site, photographs: Path) -> Iterator[tuple[Drawn, np.ndarray]]:
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
    near = dense[np.hypot(*dense.T) < DEFAULT.range_m][: DEFAULT.dashes]
    chosen = near if len(near) > 1 else floor[:2]
    step = chosen[1] - chosen[0]
    direction = math.atan(step[1] / step[0]) if step[0] else math.pi / 2
    dashes = tuple(Dash(float(x), float(y), direction, 0.05, 0.025, 9) for x, y in chosen)
    nearest_m = float(np.hypot(*floor.T).min())
    return DrawnLine(nearest_m, fit_line(dashes, reference_m))
