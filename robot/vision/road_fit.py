"""Does the road lie in the picture where the map says? Or would it, were the picture turned?

The map's lines, or without a map those of any lane, are looked up where the picture's pixels meet
the floor, at the believed pose and around it. They are held against the picture as it is, and as it
would be if somebody had mirrored, turned, sheared or shifted it. The measure is the covariance of
paint with what stands out in brightness and in yellow: without lines, it says nothing.
"""

import math
from collections import deque
from dataclasses import replace
from typing import Deque, NamedTuple, Optional, Tuple

import numpy as np

from robot.geometry import Pose
from robot.lens import CameraRig, Mount
from robot.navigation.road_paint import RoadPaint, bent_lane

COLUMNS, ROWS = 40, 30  # of the small picture: 4 x 4 pixels of a frame
WIDE = 9  # small pixels; lines stand out from their surroundings of this size
FAR_M = 0.8  # ahead of the axle: farther lines are thinner than a pixel
# A mounting, and an overhead pose with the camera's delay, may be off by so much.
PITCHES_RAD = tuple(math.radians(deg) for deg in (-7.0, 0.0, 7.0))
YAWS_RAD = tuple(math.radians(deg) for deg in (-12.0, -6.0, 0.0, 6.0, 12.0))
ASIDE_M = (-0.06, 0.0, 0.06)
# Where nothing tells the pose, a robot that keeps its lane may stand otherwise by more.
LANE_YAWS_RAD = tuple(math.radians(deg) for deg in (-30.0, -20.0, -10.0, 0.0, 10.0, 20.0, 30.0))
LANE_ASIDE_M = (-0.08, 0.0, 0.08)
BENDS_PM = (-3.5, -1.5, 0.0, 1.5, 3.5)  # the tightest lane has a radius of a quarter of a metre
CLIPPED = 3.0  # mean deviations; one lamp shall not outweigh a road
WHITE_LEVEL = 250  # of all colours, where a sensor has had too much light
LEAST_LEVELS = 2.0  # of deviation: below that there is only noise
TURNS, SHIFT_TURNS, ROLL_TURNS = 20, 40, 60  # of the loop that are judged together
# Of another reading's fit that the picture as it is must not reach: half, where honest pictures in
# bends came near.
SHARE, HALF = 0.6, 0.5
# By how much another reading must fit better: more than it did in most honest missions in random
# looks. A small shift or roll is most like a bend, and takes longer to tell. An honest picture fits
# by 1.2 there, in the nominal look by 2, and a spoiled one as badly as 0.
MIRRORED, UPSIDE_DOWN, SHEARED, SHIFTED, ROLLED = 0.55, 0.7, 0.75, 0.6, 0.75


class Reading(NamedTuple):
    """A way in which a picture may be wrong, and where (N,) its pixels then lie."""

    sentence: str
    columns: np.ndarray
    rows: np.ndarray
    margin: float = 0.5  # by which it must fit better than the picture as it is
    anywhere: bool = True  # told without a map, too
    share: float = SHARE
    turns: int = TURNS


def readings(columns: np.ndarray, rows: np.ndarray) -> Tuple[Reading, ...]:
    """The right reading first. Columns and rows (N,) count from the picture's middle."""

    def sheared(share: float, still_row: float) -> Reading:
        x = (columns + share * (rows - still_row) + 0.5 * COLUMNS) % COLUMNS - 0.5 * COLUMNS
        return Reading("sheared", x, rows, SHEARED, share=HALF)

    def turned(degrees: float) -> Tuple[np.ndarray, np.ndarray]:
        c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
        return c * columns + s * rows, c * rows - s * columns

    def rolled(degrees: float) -> Reading:
        return Reading("rolled", *turned(degrees), ROLLED, False, HALF, ROLL_TURNS)

    def shifted(right: float, down: float) -> Reading:
        x = (columns + right + 0.5 * COLUMNS) % COLUMNS - 0.5 * COLUMNS
        y = (rows + down + 0.5 * ROWS) % ROWS - 0.5 * ROWS
        return Reading("shifted", x, y, SHIFTED, False, HALF, SHIFT_TURNS)

    return (
        Reading("", columns, rows),
        Reading("mirrored", -columns, rows, MIRRORED),
        Reading("upside down", -columns, -rows, UPSIDE_DOWN),
        Reading("upside down and mirrored", columns, -rows, UPSIDE_DOWN),
        *(Reading("rolled", *turned(way), UPSIDE_DOWN, False) for way in (-90.0, 90.0)),
        *(rolled(degrees) for degrees in (-28.0, 28.0)),
        *(sheared(share, 0.0) for share in (-0.8, 0.8)),
        *(sheared(share, -0.5 * ROWS) for share in (-1.0, 1.0)),
        *(shifted(right, 0.0) for right in (-10.0, 10.0, 20.0)),
        *(shifted(0.0, down) for down in (-10.0, 10.0, 15.0)),
    )


def washed_out(picture: np.ndarray) -> bool:
    """Whether most of the floor, in the lower half (H, W, 3), is white: too bright for a road."""
    return float((picture[len(picture) // 2 :].min(axis=-1) >= WHITE_LEVEL).mean()) > 0.5


class RoadFit:
    """Holds a road against pictures as each reading would have them.

    With the ``paint`` of a map that is its road, from where the robot believes to be; a mounting
    and an overhead pose may be off. Without, any road, straight or bent, as a robot sees it that
    keeps to its right lane. A picture that is shifted, rolled or sheared a little cannot be told
    then from a robot that is turned, or from a bend; one that is mirrored shows the same as one
    from the wrong side of the yellow line, which is as bad.
    """

    def __init__(self, rig: CameraRig, paint: Optional[RoadPaint] = None) -> None:
        self._paint = paint
        rows, columns = np.mgrid[:ROWS, :COLUMNS]
        floors = np.array([_floor(rig, pitch_rad) for pitch_rad in PITCHES_RAD])
        with np.errstate(invalid="ignore"):
            near = (np.hypot(floors[..., 0], floors[..., 1]) < FAR_M) & (floors[..., 0] > 0.0)
        chosen = near.any(axis=0) & ((rows + columns) % 2 == 0)
        middle = 0.5 * (COLUMNS - 1), 0.5 * (ROWS - 1)
        told = readings(columns[chosen] - middle[0], rows[chosen] - middle[1])
        self.readings = tuple(each for each in told if each.anywhere or paint is not None)
        self._pixels = np.array([_pixels(reading) for reading in self.readings])
        points = np.nan_to_num(floors[:, chosen])
        yaws_rad, aside_m = (LANE_YAWS_RAD, LANE_ASIDE_M) if paint is None else (YAWS_RAD, ASIDE_M)
        around = [Pose(0.0, left_m, yaw_rad) for left_m in aside_m for yaw_rad in yaws_rad]
        turned = [pose.to_world(points) for pose in around]
        self._points_m = np.concatenate(turned).astype(np.float32)  # (A, N, 2), robot frame
        self._near = np.tile(near[:, chosen], (len(around), 1)).astype(np.float32)
        if paint is None:
            bends = [bent_lane(self._points_m.astype(float), bend_pm) for bend_pm in BENDS_PM]
            self._near = np.tile(self._near, (len(BENDS_PM), 1))
            self._lane = _lines(np.concatenate(bends), self._near)

    def fits(self, frame: np.ndarray, pose: Optional[Pose]) -> Optional[np.ndarray]:
        """How well each reading fits a frame (pitches, readings): the best of the poses around.

        None where a map's paint needs a pose, and the robot knows none, or of a washed-out floor.
        """
        import cv2

        small = cv2.resize(frame, (COLUMNS, ROWS), interpolation=cv2.INTER_AREA)
        if washed_out(small):
            return None
        if self._paint is None:
            bright, yellow = self._lane
        elif pose is not None:
            bright, yellow = _lines(self._paint.at(*self._on_map(pose)), self._near)
        else:
            return None
        red, green, blue = np.moveaxis(small.astype(np.float32), -1, 0)
        planes = np.stack(((red + green + blue) / 3.0, (red + green) / 2.0 - blue), axis=-1)
        planes -= cv2.blur(planes, (WIDE, WIDE), borderType=cv2.BORDER_REFLECT)
        picture = planes.reshape(-1, 2)  # what stands out in brightness and in yellow
        deviation = 1.2 * np.abs(picture[self._pixels[0]]).mean(axis=0) + LEAST_LEVELS
        scaled = np.clip(picture / deviation, -CLIPPED, CLIPPED)
        beyond = np.zeros((1, 2), np.float32)  # a reading's pixels beyond the picture
        seen = np.concatenate((scaled, beyond))[self._pixels]  # (readings, N, 2)
        fit = bright @ seen[..., 0].T + yellow @ seen[..., 1].T
        per_pixel = fit * np.float32(10.0 / self._near.shape[1])
        return np.asarray(per_pixel.reshape(-1, len(PITCHES_RAD), len(self.readings)).max(axis=0))

    def _on_map(self, pose: Pose) -> Tuple[np.ndarray, np.ndarray]:
        """The pixels' places in the world (A, N); in single precision, as everything here."""
        c, s = np.float32(math.cos(pose.heading_rad)), np.float32(math.sin(pose.heading_rad))
        ahead, left = self._points_m[..., 0], self._points_m[..., 1]
        x_m = np.float32(pose.x_m) + c * ahead - s * left
        return x_m, np.float32(pose.y_m) + s * ahead + c * left


class Verdict:
    """Adds up the fits of the last turns."""

    def __init__(self, kinds: Tuple[Reading, ...]) -> None:
        self._others = kinds[1:]
        told = [(reading.margin, reading.share, reading.turns) for reading in self._others]
        self._margins, self._shares, self._turns = np.array(told).reshape(-1, 3).T
        self._fits: Deque[np.ndarray] = deque(maxlen=ROLL_TURNS)

    def forget(self) -> None:
        """Begin anew."""
        self._fits.clear()

    def add(self, fits: np.ndarray) -> str:
        """What is wrong with the pictures, or "", after one more turn's fits."""
        self._fits.append(fits)
        worst, seems = 0.0, ""
        for turns in (TURNS, SHIFT_TURNS, ROLL_TURNS):
            # the best of the pitches: a mounting's stays
            mean = np.sum(list(self._fits)[-turns:], axis=0).max(axis=0) / turns
            others = np.where(self._turns == turns, mean[1:], 0.0)
            clearly = (others - mean[0] > self._margins) & (mean[0] < self._shares * others)
            best = int(np.where(clearly, others, 0.0).argmax())
            if clearly[best] and others[best] > worst:
                worst, seems = float(others[best]), self._others[best].sentence
        return seems


def _floor(rig: CameraRig, pitch_rad: float) -> np.ndarray:
    """Where the small picture's pixels meet the floor (ROWS, COLUMNS, 2) [m], robot frame."""
    assert isinstance(rig.mount, Mount)  # of a robot's camera
    mount = replace(rig.mount, pitch_rad=rig.mount.pitch_rad + pitch_rad)
    rows, columns = np.mgrid[:ROWS, :COLUMNS]
    pixels = np.stack((columns, rows), axis=-1).astype(float)
    return CameraRig(rig.lens.scaled(COLUMNS, ROWS), mount).to_floor(pixels)


def _pixels(reading: Reading) -> np.ndarray:
    """Indices (N,) into a flat picture; one beyond its end for pixels outside of it."""
    columns = np.rint(reading.columns + 0.5 * (COLUMNS - 1)).astype(int)
    rows = np.rint(reading.rows + 0.5 * (ROWS - 1)).astype(int)
    inside = (columns >= 0) & (columns < COLUMNS) & (rows >= 0) & (rows < ROWS)
    return np.where(inside, rows * COLUMNS + columns, COLUMNS * ROWS)


def _lines(cover: np.ndarray, near: np.ndarray) -> Tuple[np.ndarray, np.ndarray]:
    """How lines stand out in brightness and in yellow, (A, N) each, among the known and near.
    ``cover`` is white, yellow and known (A, N, 3), from A poses and bends."""
    weights = cover[..., 2] * near
    share = weights / (weights.sum(axis=1, keepdims=True) + np.float32(1e-6))

    def stands_out(paint: np.ndarray) -> np.ndarray:
        return np.asarray((paint - (paint * share).sum(axis=1, keepdims=True)) * weights)

    return stands_out(cover[..., 0] + cover[..., 1]), stands_out(cover[..., 1])
