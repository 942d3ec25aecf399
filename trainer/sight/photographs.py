"""Photographs on which a person drew the lines, as pictures to learn from.

What they show of the lane is the arc that fits the drawn lines, laid on the floor by the nominal
camera. The rule by which they are drawn stands in docs/photographs.md.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

from robot.camera.files import read_picture
from robot.camera.source import fit_to_frame
from robot.errors import ConfigError
from robot.inference.preprocess import preprocess
from robot.lens import CameraRig
from robot.typed_config import load_yaml
from sim_pybullet.look import NOMINAL
from trainer.division import division
from trainer.sight.pictures import IMAGE, Pictures, is_seen, of_photograph

SHIPPED = Path(__file__).with_name("photographs.yaml")
YELLOW_M, WHITE_M = 0.2 * 0.585, -0.232 * 0.585  # to the left of the middle of a lane
_NEAR_M, _APART_M = 0.7, 0.03  # how far lines count, in points so far apart
_LEAST = 3  # points of a line
_USUAL = np.array((0.15, 0.6, 2.5))  # offset, heading, curvature: more is doubted
_DRAWN_M = 0.01  # standard deviation of a line of four points; of more, as of four
_MISFIT_M = 0.03  # rms, beyond which the lane is no arc

Polyline = tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class Annotated:
    """One photograph."""

    file: str
    actions: str = ""  # of each action s(ensible), a(rguable) or w(rong); none: nobody can tell
    yellow: tuple[Polyline, ...] = ()  # every yellow line, from near to far [px]
    white: Polyline = ()  # the line to the right of the robot's lane [px]
    thing: bool = False  # whether something is on that lane within half a metre


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


def annotations_of(photographs: Path) -> Annotations:
    """Those in a folder of photographs, or else those that come with the project."""
    own = photographs / SHIPPED.name
    return load_yaml(Annotations, own if own.is_file() else SHIPPED)


def frames_of(site: Site, photographs: Path) -> Iterator[tuple[Annotated, np.ndarray]]:
    """Each annotated photograph with its frame (120, 160, 3) uint8 RGB.

    ``photographs``: the folder that holds the sites' folders. ConfigError if one is missing.
    """
    for drawn in site.photographs:
        path = photographs / site.folder / "images" / drawn.file
        if not path.is_file():
            own = f"{photographs / SHIPPED.name} names your own"
            raise ConfigError(f"{path}: expected an annotated photograph, found none; {own}")
        yield drawn, fit_to_frame(read_picture(path))


def on_floor(points: Polyline, size: tuple[int, int], rig: CameraRig) -> np.ndarray:
    """(M, 2) [m], robot frame: where drawn points lie; those above the horizon are left out."""
    scaled = CameraRig(rig.lens.scaled(*size), rig.mount)
    floor = scaled.to_floor(np.asarray(points, dtype=float) - 0.5)
    return np.asarray(floor[np.isfinite(floor).all(axis=1)])


def dense(floor: np.ndarray, apart_m: float) -> np.ndarray:
    """(K, 2) points so far apart along a line (M, 2); none of a point."""
    if len(floor) < 2:
        return np.empty((0, 2))
    arc = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(floor, axis=0).T))))
    ways = np.arange(0.0, arc[-1], apart_m)
    return np.stack([np.interp(ways, arc, floor[:, k]) for k in (0, 1)], axis=1)


def learned_from(photographs: Path) -> Pictures:
    """What can be learned from annotated photographs, less those of sites kept for judging.

    ConfigError if one is missing, or none shows a lane.
    """
    told, images, labels = annotations_of(photographs), [], []
    for site in told.sites:
        if site.name in division().sites.judging:
            continue
        for drawn, frame in frames_of(site, photographs):
            if (lane := lane_of(drawn, told.size)) and is_seen(*lane[:2]):
                images.append(preprocess(frame, IMAGE))
                labels.append(of_photograph(lane, drawn.thing))
    if not labels:
        raise ConfigError(f"{photographs}: expected photographs with lines of a lane, found none")
    return Pictures(np.stack(images), np.stack(labels))


def lane_of(drawn: Annotated, size: tuple[int, int]) -> tuple[float, float, float] | None:
    """Offset [m], heading [rad] and curvature [1/m] of the lane that fits; None: none does."""
    lines, rig = [], NOMINAL.rig()
    for beside_m, points in ((YELLOW_M, drawn.yellow[:1]), (WHITE_M, [drawn.white])):
        for each in filter(None, points):
            near = dense(on_floor(each, size, rig), _APART_M)
            near = near[np.hypot(*near.T) < _NEAR_M]
            if len(near) >= _LEAST:
                lines.append((beside_m, near))
    if not lines:
        return None
    fits = [least_squares(_misfit, (0.0, turn, 0.0), args=(lines,)) for turn in (-0.6, 0.0, 0.6)]
    best = min(fits, key=lambda fit: float(fit.cost)).x
    off_m = np.concatenate([_off(best, *line) for line in lines])
    return tuple(best.tolist()) if math.sqrt(np.mean(off_m**2)) < _MISFIT_M else None


def _misfit(lane: np.ndarray, lines: Sequence[tuple[float, np.ndarray]]) -> np.ndarray:
    offs = [_off(lane, *line) / (_DRAWN_M * math.sqrt(len(line[1]) / 4.0)) for line in lines]
    return np.concatenate((lane / _USUAL, *offs))


def _off(lane: np.ndarray, beside_m: float, points: np.ndarray) -> np.ndarray:
    """How far points (K, 2) lie to the left of the line so far beside the middle of a lane."""
    offset_m, heading_rad, bend_pm = lane.tolist()
    c, s = math.cos(heading_rad), math.sin(heading_rad)
    along, left = points @ (c, -s), points @ (s, c) + offset_m
    # From the circle that the middle is; so written, it may be a straight line as well.
    root = np.hypot(bend_pm * along, 1.0 - bend_pm * left)
    return np.asarray((2.0 * left - bend_pm * (along**2 + left**2)) / (1.0 + root) - beside_m)
