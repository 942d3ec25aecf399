"""An independent model of the camera above an arena, and flat pictures drawn with it."""

import math
from dataclasses import dataclass, replace
from typing import Sequence, Tuple

import cv2
import numpy as np

from localizer_node.calibrate import KnownPoint
from localizer_node.calibration import Calibration, Marker
from localizer_node.detect import draw_tag
from robot.lens import Hanging, Lens

MAP_M = (2.2, 2.64)
SIDE_PX = 1280  # square, so that the arena is in view whatever way the camera is turned
SIZE = (SIDE_PX, SIDE_PX)
FISHEYE = Lens("fisheye", *SIZE, 700.0, 702.0, 641.0, 632.0, (0.02, -0.008, 0.001, 0.0))
PINHOLE = Lens("pinhole", *SIZE, 640.0, 640.0, 639.5, 639.5)
PLUMB_BOB = Lens("plumb_bob", *SIZE, 690.0, 690.0, 630.0, 645.0, (-0.18, 0.03, 1e-3, -5e-4, 0.0))
LENSES = (FISHEYE, PINHOLE, PLUMB_BOB)
FLOOR_RGB = (52, 52, 56)
PAINT = {
    "blue": (30, 80, 200),
    "green": (50, 180, 80),
    "magenta": (210, 40, 150),
    "white": (225, 225, 220),
}


@dataclass(frozen=True)
class Rig:
    """A camera that looks down; ``yaw_rad`` turns picture-right from east, counter-clockwise."""

    lens: Lens = FISHEYE
    position_m: Tuple[float, float, float] = (1.12, 1.3, 2.5)
    yaw_rad: float = 0.0
    tilt_rad: Tuple[float, float] = (0.0, 0.0)

    @property
    def to_camera(self) -> np.ndarray:
        c, s = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        down = np.array([[c, s, 0.0], [s, -c, 0.0], [0.0, 0.0, -1.0]])
        return cv2.Rodrigues(np.array([*self.tilt_rad, 0.0]))[0] @ down

    def see(self, points_m: np.ndarray, height_m: float = 0.0) -> np.ndarray:
        """Pixels of points (..., 2) at a height: Euclid and the lens, no homography."""
        points = np.asarray(points_m, dtype=float)
        world = np.concatenate((points, np.full((*points.shape[:-1], 1), height_m)), axis=-1)
        return self.lens.project((world - self.position_m) @ self.to_camera.T)

    def known(self, points_m: np.ndarray, noise_px: float = 0.0, seed: int = 0) -> list:
        noise = np.random.default_rng(seed).normal(0.0, noise_px, (len(points_m), 2))
        pixels = self.see(points_m) + noise
        return [KnownPoint(*map(float, (*p, *q))) for p, q in zip(pixels, points_m)]

    def calibration(self, robots: Sequence[Marker] = (Marker(),)) -> Calibration:
        hanging = Hanging.of(np.array(self.position_m), self.to_camera.T)
        return Calibration(self.lens, hanging, map_size_m=MAP_M, robots=tuple(robots))

    def floor(self) -> np.ndarray:
        """A picture of the bare floor."""
        picture = np.empty((self.lens.height_px, self.lens.width_px, 3), np.uint8)
        picture[:] = FLOOR_RGB
        return picture

    def paint(
        self,
        picture: np.ndarray,
        colour: str,
        pose: Tuple[float, float, float],
        rect_m: Tuple[float, float, float, float],
        height_m: float = 0.0,
    ) -> None:
        """A rectangle (back, front, right, left) in the frame of a pose, smooth at its edges."""
        back, front, right, left = rect_m
        corners = [(back, right), (front, right), (front, left), (back, left)]
        pixels = self.see(at(pose, np.array(corners)), height_m)
        fixed = np.round(pixels * 16.0).astype(np.int32)
        cv2.fillPoly(picture, [fixed], PAINT[colour], cv2.LINE_AA, shift=4)

    def paint_robot(
        self, picture: np.ndarray, marker: Marker, pose: Tuple[float, float, float]
    ) -> None:
        board = marker.board
        back, half = board.forward_m - board.length_m / 2.0, board.width_m / 2.0
        front, height = back + board.length_m, board.height_m
        self.paint(picture, "blue", pose, (back, front, -half, half), height)
        if marker.kind == "two_colour":
            self.paint(
                picture, marker.front, pose, (front - board.front_m, front, -half, half), height
            )
        if marker.kind == "tag":
            self._paint_tag(picture, marker, pose)

    def _paint_tag(
        self, picture: np.ndarray, marker: Marker, pose: Tuple[float, float, float]
    ) -> None:
        tag = draw_tag(marker.tag)
        half = marker.board.tag_m * 1.25 / 2.0
        corners = np.array([(half, half), (half, -half), (-half, -half), (-half, half)])
        corners[:, 0] += marker.board.forward_m
        target = self.see(at(pose, corners), marker.board.height_m).astype(np.float32)
        side = float(tag.shape[0])
        source = np.array([(0, 0), (side, 0), (side, side), (0, side)], np.float32) - 0.5
        scale = 4  # drawn larger and averaged, as a lens would
        matrix = cv2.getPerspectiveTransform(source, (target + 0.5) * scale - 0.5)
        size = (picture.shape[1] * scale, picture.shape[0] * scale)
        low = (np.floor(target.min(axis=0)) - 2).astype(int)
        high = (np.ceil(target.max(axis=0)) + 3).astype(int)
        shift = np.array([[1.0, 0.0, -low[0] * scale], [0.0, 1.0, -low[1] * scale], [0, 0, 1]])
        size = tuple(int(v) for v in (high - low) * scale)
        drawn = cv2.warpPerspective(tag, shift @ matrix, size, flags=cv2.INTER_AREA)
        cover = cv2.warpPerspective(np.full_like(tag, 255), shift @ matrix, size)
        small = tuple(int(v) for v in high - low)
        drawn = cv2.resize(drawn, small, interpolation=cv2.INTER_AREA).astype(float)
        alpha = cv2.resize(cover, small, interpolation=cv2.INTER_AREA).astype(float) / 255.0
        window = picture[low[1] : high[1], low[0] : high[0]]
        window[:] = np.round(window * (1.0 - alpha) + drawn).astype(np.uint8)

    def turned(self, yaw_rad: float) -> "Rig":
        return replace(self, yaw_rad=yaw_rad)


def at(pose: Tuple[float, float, float], points_m: np.ndarray) -> np.ndarray:
    """Points (N, 2) of a pose's frame in the world."""
    x, y, heading = pose
    c, s = math.cos(heading), math.sin(heading)
    return np.array([x, y]) + points_m @ np.array([[c, s], [-s, c]])


def grid(count: int = 4, margin_m: float = 0.0) -> np.ndarray:
    """(count * count, 2) places spread over the map."""
    x = np.linspace(margin_m, MAP_M[0] - margin_m, count)
    y = np.linspace(margin_m, MAP_M[1] - margin_m, count)
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


def turn(a_rad: float, b_rad: float) -> float:
    """How far apart two headings are."""
    return abs((a_rad - b_rad + math.pi) % (2.0 * math.pi) - math.pi)
