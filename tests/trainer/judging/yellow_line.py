"""The yellow line of the road in one camera frame: where it runs, and whether we crossed it.

As paper A, section 4.1: RGB to HSV, a yellow mask, the middles of its dashes, a parabola through
them. Colours are balanced by the road, which is grey whatever the camera makes of it. Dashes are
measured and fitted in metres on the floor. The line is judged at the nearest point ahead of the
robot that its camera sees, 12 cm ahead of the axle. Traffic keeps right: the line belongs on the
robot's left.
"""

import itertools
import math
from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import cv2
import numpy as np

from robot.errors import ContractError
from robot.geometry import Pose, wrap_angle
from robot.lens import CameraRig

# What is yellow; saturation and value of 1.
HUE_DEG = (32.0, 72.0)  # red is 0, green 120; after the white balance
MIN_SATURATION = 0.35  # after the white balance
RAW_SATURATION = 0.55  # before it, of pixels that overexposure clipped
CLIPPED = 0.9  # value of those: the balance tells no hue of them
MIN_VALUE = 0.22  # darker pixels are noise
BRIGHTER = 1.35  # than the road
MAX_GAIN = 2.5  # of the white balance
# What is a dash, and what a line.
RANGE_M = 1.0  # ahead of the axle
MIN_PIXELS = 3  # fewer have no direction
MAX_WIDTH_M = 0.06
DASH_M = 0.08  # longer blobs (merged by blur) are cut into pieces of this length
DASHES = 5  # the nearest so many are fitted
MAX_STEP_M = 0.25  # from one dash to the next
MAX_TURN_RAD = 0.9  # and how far it may turn off
ALONE_M = 0.5  # a farther dash is a line only together with others
MAX_BEND_PM = 2.5  # half the curvature of the tightest line [1/m]
MAX_EXTENSION = 2.0  # of its own length, up to which a bent line is carried on
LINE_POINTS = 12  # of a fit that is drawn


class Dash(NamedTuple):
    """One piece of the line: its middle, its direction and its extent on the floor."""

    x_m: float
    y_m: float
    direction_rad: float  # (-pi/2, pi/2]
    length_m: float
    width_m: float
    pixels: int


class YellowLine(NamedTuple):
    """The line, robot frame [m], judged at the nearest point ahead of the robot that is seen.

    Without a line ``found`` is False and the numbers are NaN.
    """

    found: bool
    offset_m: float = math.nan  # of the point ahead of the robot, positive to the line's left
    heading_rad: float = math.nan  # of the line there
    dashes: tuple[Dash, ...] = ()  # fitted, the nearest first
    line_m: tuple[tuple[float, float], ...] = ()  # points along the fit, from the robot on

    @property
    def crossed(self) -> bool | None:
        """Whether that point is left of the line; None when no line was found."""
        return self.offset_m > 0.0 if self.found else None


NOT_FOUND = YellowLine(False)


class FloorTable(NamedTuple):
    """Where each pixel meets the floor: (H, W, 2) [m], robot frame; its area (H, W) [m^2]."""

    points_m: np.ndarray
    area_m2: np.ndarray
    near: np.ndarray  # (H, W) bool: within range
    reference_m: float  # ahead of the axle: the floor at the middle of the lower edge


@lru_cache(maxsize=8)
def floor_table(
    rig: CameraRig, width_px: int, height_px: int, range_m: float = RANGE_M
) -> FloorTable:
    """The floor as this camera sees it, for one picture size."""
    scaled = CameraRig(rig.lens.scaled(width_px, height_px), rig.mount)
    v, u = np.mgrid[0:height_px, 0:width_px]
    points = scaled.to_floor(np.stack((u, v), axis=-1))
    with np.errstate(invalid="ignore"):
        dv, du = np.gradient(points, axis=(0, 1))
        area = np.abs(dv[..., 0] * du[..., 1] - dv[..., 1] * du[..., 0])
        ahead = points[..., 0] > 0.0
        near = np.isfinite(area) & ahead & (np.hypot(points[..., 0], points[..., 1]) < range_m)
    lowest = scaled.to_floor(np.array((0.5 * width_px - 0.5, height_px - 0.5)))
    return FloorTable(points, area, near, float(lowest[0]))


def detect_yellow_line(frame: np.ndarray, rig: CameraRig) -> YellowLine:
    """Find the yellow line in a whole frame (H, W, 3) uint8 RGB of any size; else ContractError.

    ``rig``: the camera's lens, for a picture of any size, and its mounting.
    """
    if frame.ndim != 3 or frame.shape[2] != 3 or frame.dtype != np.uint8:
        raise ContractError(f"frame: expected (H, W, 3) uint8 RGB, got {frame.shape} {frame.dtype}")
    floor = floor_table(rig, frame.shape[1], frame.shape[0])
    return fit_line(chain(find_dashes(yellow_mask(frame, floor), floor)), floor.reference_m)


def yellow_mask(frame: np.ndarray, floor: FloorTable) -> np.ndarray:
    """Pixels (H, W) bool of yellow paint on the near floor, in the light of the road's own grey."""
    if not floor.near.any():
        return floor.near
    road = np.median(frame[floor.near], axis=0).astype(np.float32) + np.float32(1.0)
    gains = np.minimum(road.max() / road, np.float32(MAX_GAIN))
    picture = frame.astype(np.float32) / np.float32(255.0)
    balanced = cv2.cvtColor(np.minimum(picture * gains, np.float32(1.0)), cv2.COLOR_RGB2HSV)
    raw = cv2.cvtColor(picture, cv2.COLOR_RGB2HSV)
    darkest = max(MIN_VALUE, BRIGHTER * float(road.max()) / 255.0)
    yellow = _has_hue(balanced, MIN_SATURATION)
    yellow |= (raw[..., 2] >= CLIPPED) & _has_hue(raw, RAW_SATURATION)
    return floor.near & yellow & (raw[..., 2] >= min(darkest, CLIPPED))


def _has_hue(hsv: np.ndarray, saturation: float) -> np.ndarray:
    low, high = HUE_DEG
    return (hsv[..., 0] >= low) & (hsv[..., 0] <= high) & (hsv[..., 1] >= saturation)


def find_dashes(mask: np.ndarray, floor: FloorTable) -> tuple[Dash, ...]:
    """The blobs of the mask that are as wide as a line, cut to the length of a dash."""
    count, labels = cv2.connectedComponents(mask.astype(np.uint8), connectivity=8)
    found = []
    for label in range(1, count):
        rows, columns = np.nonzero(labels == label)
        points, areas = floor.points_m[rows, columns], floor.area_m2[rows, columns]
        whole = _dash(points, areas)
        pieces = max(1, round(whole.length_m / DASH_M))
        along = points @ (math.cos(whole.direction_rad), math.sin(whole.direction_rad))
        edges = np.linspace(along.min(), along.max() + 1e-9, pieces + 1)
        for low, high in itertools.pairwise(edges):
            here = (along >= low) & (along < high)
            if here.sum() >= MIN_PIXELS:
                found.append(_dash(points[here], areas[here]))
    return tuple(dash for dash in found if dash.width_m <= MAX_WIDTH_M)


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
    x_m, y_m = middle.tolist()
    return Dash(x_m, y_m, direction, float(length), float(width), len(points))


def chain(dashes: Sequence[Dash]) -> tuple[Dash, ...]:
    """The dashes of one line: from the nearest on, each the next one roughly straight on."""
    left = sorted(dashes, key=lambda dash: math.hypot(dash.x_m, dash.y_m))
    line, left = left[:1], left[1:]
    while left and len(line) < DASHES:
        ahead = [dash for dash in left if _follows(line, dash)]
        if not ahead:
            break
        line.append(min(ahead, key=lambda dash: math.dist(line[-1][:2], dash[:2])))
        left.remove(line[-1])
    if len(line) == 1 and math.hypot(line[0].x_m, line[0].y_m) > ALONE_M:
        return ()
    return tuple(line)


def _follows(line: Sequence[Dash], dash: Dash) -> bool:
    if math.dist(line[-1][:2], dash[:2]) > MAX_STEP_M:
        return False
    turn = _bearing(line[-1], dash) - _bearing(line[-2], line[-1]) if len(line) > 1 else 0.0
    return abs(float(wrap_angle(turn))) <= MAX_TURN_RAD


def _bearing(start: Dash, end: Dash) -> float:
    return math.atan2(end.y_m - start.y_m, end.x_m - start.x_m)


def fit_line(dashes: Sequence[Dash], reference_m: float) -> YellowLine:
    """A parabola through the dashes' middles; a straight line where there are only one or two.

    ``reference_m``: how far ahead of the axle the point lies whose side is asked for [m].
    """
    if not dashes:
        return NOT_FOUND
    middles = np.array([(dash.x_m, dash.y_m) for dash in dashes])
    direction = dashes[0].direction_rad
    if len(dashes) > 1:
        chord = middles[min(len(dashes) - 1, 2)] - middles[0]
        # the same axis, as the direction that leads ahead of the robot
        direction = math.atan(math.tan(math.atan2(chord[1], chord[0])))
    # In this frame, the first dash at its origin, the line is a function of the way along it.
    frame = Pose(dashes[0].x_m, dashes[0].y_m, direction)
    along, across = frame.to_robot(middles).T
    at_m, side_m = frame.to_robot(np.array((reference_m, 0.0)))
    # A short piece far away tells no bend: carried on to the robot it would lead anywhere.
    order = len(dashes) if abs(at_m) <= MAX_EXTENSION * np.ptp(along) else 2
    terms = np.vander(along, 3)[:, -min(order, len(dashes)) :]
    fitted = np.linalg.lstsq(terms, across, rcond=None)[0]
    curve = np.concatenate((np.zeros(3 - len(fitted)), fitted))
    curve[0] = np.clip(curve[0], -MAX_BEND_PM, MAX_BEND_PM)
    slope = 2.0 * curve[0] * at_m + curve[1]
    offset_m = (side_m - np.polyval(curve, at_m)) / math.hypot(1.0, slope)
    ways = np.linspace(min(at_m, 0.0), along.max(), LINE_POINTS)
    points = frame.to_world(np.stack((ways, np.polyval(curve, ways)), axis=1))
    heading_rad = float(wrap_angle(direction + math.atan(slope)))
    return YellowLine(True, float(offset_m), heading_rad, tuple(dashes), tuple(points.tolist()))
