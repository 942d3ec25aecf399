"""The printed chessboard: drawing it, finding it in a picture, and pictures of it."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path
from typing import List, Optional, Tuple

import numpy as np

from robot.camera.files import picture_files, read_picture
from robot.config import CameraConfig
from robot.errors import ConfigError
from robot.runtime.assemble import open_stream

COLUMNS, ROWS = 8, 5  # squares; one even and one odd number, so that it has one way up only
SQUARE_M = 0.03
CORNERS = (COLUMNS - 1, ROWS - 1)  # inner ones, across and along
SHEET = Path(__file__).with_name("target.pdf")  # A4, landscape; the board fits on US Letter too


def board_points_m(near_edge_m: float) -> np.ndarray:
    """(28, 3) inner corners on the floor, robot frame: far row first, each from left to right.

    ``near_edge_m`` is from the axle to the near edge of the squares.
    """
    rows = near_edge_m + SQUARE_M * np.arange(CORNERS[1], 0, -1)
    columns = SQUARE_M * (COLUMNS / 2.0 - np.arange(1, COLUMNS))
    grid = np.stack(np.meshgrid(rows, columns, indexing="ij"), axis=-1).reshape(-1, 2)
    return np.column_stack((grid, np.zeros(len(grid))))


def find_board(picture: np.ndarray) -> Optional[np.ndarray]:
    """(28, 2) pixels of the inner corners in the order of ``board_points_m``; None without a board.

    The row that lies lower in the picture is taken for the near one.
    """
    import cv2

    grey = cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY)
    flags = cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_ACCURACY | cv2.CALIB_CB_NORMALIZE_IMAGE
    found, corners = cv2.findChessboardCornersSB(grey, CORNERS, flags=flags)
    if not found:
        return None
    grid = np.asarray(corners, dtype=np.float64).reshape(CORNERS[1], CORNERS[0], 2)
    if grid[0, :, 1].mean() > grid[-1, :, 1].mean():
        grid = grid[::-1, ::-1]
    return np.ascontiguousarray(grid).reshape(-1, 2)


SIZE_PX = (640, 480)  # four times a frame in each direction: corners are found four times as well
SETTLING = 15  # pictures until exposure and white balance have settled


def take_picture(camera: CameraConfig) -> np.ndarray:
    """(480, 640, 3) uint8 RGB of now. HardwareError: the camera does not work."""
    with closing(open_stream(camera, SIZE_PX)) as stream:
        for _ in range(SETTLING):
            stream.grab()
        return stream.grab()


def boards_from_files(folder: Path) -> Tuple[List[np.ndarray], Tuple[int, int]]:
    """The board's corners in each picture that shows it, and the size of the pictures.

    ConfigError: no pictures, or of several sizes.
    """
    boards, sizes = [], set()
    for file in picture_files(folder):
        picture = read_picture(file)
        sizes.add((picture.shape[1], picture.shape[0]))
        corners = find_board(picture)
        if corners is not None:
            boards.append(corners)
    if len(sizes) > 1:
        raise ConfigError(f"{folder}: expected pictures of one size, got {sorted(sizes)}")
    return boards, sizes.pop()
