"""Pictures of the printed board, drawn by exact projection through any lens and mount."""

from __future__ import annotations

import math
from typing import List

import numpy as np

from robot.bringup.chessboard import COLUMNS, ROWS, SQUARE_M, board_points_m
from robot.lens import CameraRig, Lens

RAYS = 2  # a pixel is the mean of 2 x 2 rays


def floor_picture(rig: CameraRig, near_edge_m: float, rng: np.random.Generator) -> np.ndarray:
    """(H, W, 3) uint8 RGB of the sheet on a grey floor, with blur and noise of a real camera."""
    import cv2

    lens = rig.lens
    sheet = SQUARE_M * np.array([(x, y, 0.0) for x in (-1, ROWS + 1) for y in (-5.0, 0.0, 5.0)])
    seen = rig.to_pixels(sheet + np.array([near_edge_m, 0.0, 0.0]))
    left, top = np.maximum(seen.min(axis=0) - 4.0, 0.0).astype(int)
    right, low = np.minimum(seen.max(axis=0) + 60.0, (lens.width_px, lens.height_px)).astype(int)
    v, u = np.mgrid[RAYS * top : RAYS * low, RAYS * left : RAYS * right]
    pixels = (np.stack((u, v), axis=-1) + 0.5) / RAYS - 0.5
    x_m, y_m = np.moveaxis(rig.to_floor(pixels), -1, 0)
    row, column = (x_m - near_edge_m) / SQUARE_M, COLUMNS / 2.0 - y_m / SQUARE_M
    on_board = (row >= 0) & (row < ROWS) & (column >= 0) & (column < COLUMNS)
    black = on_board & ((np.floor(row) + np.floor(column)) % 2 == 0)
    on_sheet = (row >= -1) & (row < ROWS + 1) & (column >= -0.95) & (column < COLUMNS + 0.95)
    part = np.where(black, 25.0, np.where(on_sheet, 225.0, 110.0))
    bright = np.full((lens.height_px, lens.width_px), 110.0)
    shape = (low - top, RAYS, right - left, RAYS)
    bright[top:low, left:right] = part.reshape(shape).mean(axis=(1, 3))
    bright = cv2.GaussianBlur(bright, (0, 0), 0.8) + rng.normal(0.0, 4.0, bright.shape)
    return np.repeat(np.clip(bright, 0, 255).astype(np.uint8)[..., None], 3, axis=2)


def held_boards(
    lens: Lens, count: int, rng: np.random.Generator, noise_px: float = 0.15
) -> List[np.ndarray]:
    """Corners (28, 2) of boards held before the lens at many angles, whole in the picture."""
    flat = board_points_m(0.0)
    flat = flat - flat.mean(axis=0)
    boards: List[np.ndarray] = []
    while len(boards) < count:
        tilt, spin = rng.uniform(-0.7, 0.7, 2), rng.uniform(-math.pi, math.pi)
        points = flat @ _turn(2, spin) @ _turn(0, tilt[0]) @ _turn(1, tilt[1])
        place = (rng.uniform(-0.35, 0.35), rng.uniform(-0.25, 0.25), rng.uniform(0.15, 0.35))
        pixels = lens.project(points + place)
        inside = (pixels > 5.0) & (pixels < np.array((lens.width_px, lens.height_px)) - 5.0)
        if inside.all():
            boards.append(pixels + rng.normal(0.0, noise_px, pixels.shape))
    return boards


def _turn(axis: int, angle_rad: float) -> np.ndarray:
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    matrix = np.eye(3)
    i, j = [other for other in range(3) if other != axis]
    matrix[i, i] = matrix[j, j] = c
    matrix[i, j], matrix[j, i] = -s, s
    return matrix
