"""Dashes of yellow paint on the floor, in one camera frame.

RGB to HSV, a yellow mask and the middles of its blobs, as in paper A, section 4.1. Two things are
added: the colours are balanced by the road first (a road is grey, whatever the camera makes of it),
and blobs are measured in metres on the floor, where a dash is as wide far away as it is near.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from robot.lens import CameraRig

CLIPPED = 0.9  # of 1: the balance tells no hue of brighter pixels


@dataclass(frozen=True)
class YellowLineParameters:
    """What counts as a dash. Lengths on the floor; hue of red is 0, of green 120 degrees."""

    hue_deg: tuple[float, float] = (32.0, 72.0)  # after the white balance
    min_saturation: float = 0.35  # of 1, after the white balance
    raw_saturation: float = 0.55  # of 1, before it, of pixels that overexposure clipped
    min_value: float = 0.22  # of 1; darker pixels are noise
    brighter: float = 1.35  # than the road
    max_gain: float = 2.5  # of the white balance
    range_m: float = 1.0  # ahead of the axle
    min_pixels: int = 3  # fewer have no direction
    max_width_m: float = 0.06
    dash_m: float = 0.08  # longer blobs (merged by blur) are cut into pieces of this length
    dashes: int = 5  # the nearest so many are fitted
    max_step_m: float = 0.25  # from one dash to the next
    max_turn_rad: float = 0.9  # and how far it may turn off
    alone_m: float = 0.5  # a farther dash is a line only together with others
    max_bend_pm: float = 2.5  # half the curvature of the tightest line [1/m]
    max_extension: float = 2.0  # of its own length, up to which a bent line is carried on


class Dash(NamedTuple):
    """One piece of the line: its middle, its direction and its extent on the floor."""

    x_m: float
    y_m: float
    direction_rad: float  # (-pi/2, pi/2]
    length_m: float
    width_m: float
    pixels: int


DEFAULT = YellowLineParameters()


class FloorTable(NamedTuple):
    """Where each pixel meets the floor: (H, W, 2) [m], robot frame; its area (H, W) [m^2]."""

    points_m: np.ndarray
    area_m2: np.ndarray
    near: np.ndarray  # (H, W) bool: within range
    reference_m: float  # ahead of the axle: the floor at the middle of the lower edge


@lru_cache(maxsize=8)
def floor_table(rig: CameraRig, width_px: int, height_px: int, range_m: float) -> FloorTable:
    """The floor as this camera sees it, for one picture size."""
    scaled = CameraRig(rig.lens.scaled(width_px, height_px), rig.mount)
    v, u = np.mgrid[0:height_px, 0:width_px]
    points = scaled.to_floor(np.stack((u, v), axis=-1))
    with np.errstate(invalid="ignore"):
        dv, du = np.gradient(points, axis=(0, 1))
        area = np.abs(dv[..., 0] * du[..., 1] - dv[..., 1] * du[..., 0])
        near = (
            np.isfinite(area)
            & (points[..., 0] > 0.0)
            & (np.hypot(points[..., 0], points[..., 1]) < range_m)
        )
    lowest = scaled.to_floor(np.array((0.5 * width_px - 0.5, height_px - 0.5)))
    return FloorTable(points, area, near, float(lowest[0]))


def yellow_mask(
    frame: np.ndarray, floor: FloorTable, parameters: YellowLineParameters = DEFAULT
) -> np.ndarray:
    """Pixels (H, W) bool of yellow paint on the near floor, in the light of the road's own grey."""
    import cv2

    if not floor.near.any():
        return floor.near
    road = np.median(frame[floor.near], axis=0).astype(np.float32) + np.float32(1.0)
    gains = np.minimum(road.max() / road, np.float32(parameters.max_gain))
    picture = frame.astype(np.float32) / np.float32(255.0)
    balanced = cv2.cvtColor(np.minimum(picture * gains, np.float32(1.0)), cv2.COLOR_RGB2HSV)
    raw = cv2.cvtColor(picture, cv2.COLOR_RGB2HSV)
    darkest = max(parameters.min_value, parameters.brighter * float(road.max()) / 255.0)
    yellow = _has_hue(balanced, parameters.hue_deg, parameters.min_saturation)
    clipped = raw[..., 2] >= CLIPPED
    yellow |= clipped & _has_hue(raw, parameters.hue_deg, parameters.raw_saturation)
    return floor.near & yellow & (raw[..., 2] >= min(darkest, CLIPPED))


def _has_hue(hsv: np.ndarray, hue_deg: tuple[float, float], saturation: float) -> np.ndarray:
    low, high = hue_deg
    return (hsv[..., 0] >= low) & (hsv[..., 0] <= high) & (hsv[..., 1] >= saturation)


def find_dashes(
    mask: np.ndarray, floor: FloorTable, parameters: YellowLineParameters = DEFAULT
) -> tuple[Dash, ...]:
    """The blobs of the mask that are as wide as a line, cut to the length of a dash."""
    import cv2

    count, labels = cv2.connectedComponents(mask.astype(np.uint8), connectivity=8)
    found = []
    for label in range(1, count):
        rows, columns = np.nonzero(labels == label)
        points, areas = floor.points_m[rows, columns], floor.area_m2[rows, columns]
        whole = _dash(points, areas)
        pieces = max(1, round(whole.length_m / parameters.dash_m))
        along = points @ (math.cos(whole.direction_rad), math.sin(whole.direction_rad))
        edges = np.linspace(along.min(), along.max() + 1e-9, pieces + 1)
        for low, high in itertools.pairwise(edges):
            here = (along >= low) & (along < high)
            if here.sum() >= parameters.min_pixels:
                dash = _dash(points[here], areas[here])
                if dash.width_m <= parameters.max_width_m:
                    found.append(dash)
    return tuple(found)


def _dash(points: np.ndarray, areas: np.ndarray) -> Dash:
    """Middle and principal axis, each pixel weighted by the floor that it covers."""
    weights = areas / areas.sum()
    middle = weights @ points
    offsets = points - middle
    covariance = (offsets * weights[:, None]).T @ offsets
    values, vectors = np.linalg.eigh(covariance)
    direction = math.atan2(vectors[1, 1], vectors[0, 1])
    if math.cos(direction) < 0.0:
        direction -= math.copysign(math.pi, direction)
    # A uniform bar of length l has variance l^2 / 12 along itself.
    width, length = np.sqrt(12.0 * np.maximum(values, 0.0))
    return Dash(
        float(middle[0]), float(middle[1]), direction, float(length), float(width), len(points)
    )
