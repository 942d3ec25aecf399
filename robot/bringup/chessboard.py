"""The printed chessboard: pictures of it, and the lens and its mount that they tell."""

import math
from contextlib import closing
from pathlib import Path
from typing import List, Optional, Sequence, Tuple

import numpy as np

from robot.bringup.camera_place import Freedom, fit_camera
from robot.camera.files import picture_files, read_picture
from robot.camera.source import open_stream
from robot.config import CameraConfig
from robot.errors import ConfigError
from robot.lens import CameraRig, Lens, Mount

COLUMNS, ROWS = 8, 5  # squares; one even and one odd number, so that it has one way up only
SQUARE_M = 0.03
CORNERS = (COLUMNS - 1, ROWS - 1)  # inner ones, across and along
SHEET = Path(__file__).with_name("target.pdf")  # A4, landscape; the board fits on US Letter too
SIZE_PX = (640, 480)  # four times a frame in each direction: corners are found four times as well
SETTLING = 15  # pictures until exposure and white balance have settled
FEWEST_PICTURES = 8
MOST_RESIDUAL_PX = 1.0  # of a picture 640 pixels wide
LEAST_COVERAGE = 0.6  # of the picture's width and height that boards were seen in
PITCH_RANGE_RAD = (math.radians(-5.0), math.radians(60.0))
HEIGHT_RANGE_M = (0.03, 0.40)
TWIST_RANGE_RAD = (-math.radians(12.0), math.radians(12.0))  # of roll, and yaw against the board
PLACE_TOLERANCE_M = 0.05  # of the board


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


def take_picture(camera: CameraConfig) -> np.ndarray:
    """(480, 640, 3) uint8 RGB of now. HardwareError: the camera does not work."""
    with closing(open_stream(camera, SIZE_PX)) as stream:
        for _ in range(SETTLING):
            stream.grab()
        return stream.grab()


def boards_from_files(folder: Path) -> Tuple[List[np.ndarray], Tuple[int, int]]:
    """The board's corners in each picture that shows it, and their size; ConfigError: several."""
    boards, sizes = [], set()
    for file in picture_files(folder):
        picture = read_picture(file)
        sizes.add((picture.shape[1], picture.shape[0]))
        corners = find_board(picture)
        if corners is not None:
            boards.append(corners)
    if len(sizes) > 1 or any(3 * width != 4 * height for width, height in sizes):
        raise ConfigError(f"{folder}: expected 4:3 pictures of one size, got {sorted(sizes)}")
    return boards, sizes.pop()


def fit_lens(boards_px: Sequence[np.ndarray], size_px: Tuple[int, int]) -> Tuple[Lens, float]:
    """The equidistant lens (Kannala and Brandt 2006) that saw the boards, and its residual [px].

    From boards (28, 2) in pictures of this size. ConfigError: too few, in the middle only, or a
    bad fit.
    """
    import cv2

    if len(boards_px) < FEWEST_PICTURES:
        raise ConfigError(
            f"lens: expected {FEWEST_PICTURES} pictures or more in which the board is seen, got "
            f"{len(boards_px)}; hold it still, whole in the picture, in even light"
        )
    covered = min(np.ptp(np.concatenate(list(boards_px)), axis=0) / size_px)
    if covered < LEAST_COVERAGE:
        raise ConfigError(
            f"lens: the boards cover {100 * covered:.0f} % of the width or height, expected "
            f"{100 * LEAST_COVERAGE:.0f} %; hold the board into every corner of the picture"
        )
    board = board_points_m(0.0)[:, None, :]
    corners = [np.ascontiguousarray(c[:, None, :]) for c in boards_px]
    width, height = size_px
    guess = np.array([[0.5 * width, 0.0, 0.5 * width], [0.0, 0.5 * width, 0.5 * height], [0, 0, 1]])
    flags = cv2.fisheye.CALIB_RECOMPUTE_EXTRINSIC | cv2.fisheye.CALIB_FIX_SKEW
    flags |= cv2.fisheye.CALIB_USE_INTRINSIC_GUESS
    end = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 200, 1e-8)
    try:
        residual_px, k, distortion, _, _ = cv2.fisheye.calibrate(
            [board] * len(corners), corners, size_px, guess, np.zeros(4), None, None, flags, end
        )
    except cv2.error as error:
        raise ConfigError(
            f"lens: no lens fits the pictures ({error.err}); tilt the {COLUMNS} by {ROWS} board "
            "more, and take those out in which corners were mistaken"
        ) from error
    most_px = MOST_RESIDUAL_PX * width / 640.0
    if not residual_px <= most_px:
        raise ConfigError(
            f"lens: the corners miss the fitted lens by {residual_px:.2f} px, expected at most "
            f"{most_px:.2f}; is the sheet flat, are the pictures sharp and all of one size?"
        )
    fx, fy, cx, cy = (float(k[i]) for i in ((0, 0), (1, 1), (0, 2), (1, 2)))
    bent = tuple(float(v) for v in np.ravel(distortion))
    return Lens("fisheye", width, height, fx, fy, cx, cy, bent), float(residual_px)


def fit_mount(
    corners_px: np.ndarray, lens: Lens, near_edge_m: float, before: Mount
) -> Tuple[Mount, float]:
    """The mount, by least squares of the reprojection error, and its residual [px].

    From corners (28, 2) of ``find_board``, and the lens at that picture's size. Pitch, roll and
    height do not depend on where the board lies; yaw, ``forward_m`` and ``left_m`` are as good as
    the board's placing. ConfigError: no camera can see the board so, or none that was ``before``.
    """
    points_m = board_points_m(near_edge_m)
    fit = fit_camera(corners_px, points_m[:, :2], lens, Freedom())
    matrix = fit.rotation.T @ Mount(pitch_rad=0.0).rotation.T
    forward_m, left_m, height_m = (float(v) for v in fit.position_m)
    mount = Mount(
        height_m,
        forward_m,
        left_m,
        pitch_rad=math.asin(max(-1.0, min(1.0, -float(matrix[2, 0])))),
        yaw_rad=math.atan2(float(matrix[1, 0]), float(matrix[0, 0])),
        roll_rad=math.atan2(float(matrix[2, 1]), float(matrix[2, 2])),
    )
    misses_px = CameraRig(lens, mount).to_pixels(points_m) - corners_px
    residual_px = float(np.sqrt(np.mean(np.sum(misses_px**2, axis=1))))
    most_px = MOST_RESIDUAL_PX * lens.width_px / 640.0
    if residual_px > most_px:
        raise ConfigError(
            f"camera: the corners miss the fitted board by {residual_px:.2f} px, expected at "
            f"most {most_px:.2f}; is the sheet flat, printed at 100 %, and the lens calibrated?"
        )
    for what, value, (low, high) in (
        ("height_m", mount.height_m, HEIGHT_RANGE_M),
        ("pitch_rad", mount.pitch_rad, PITCH_RANGE_RAD),
        ("roll_rad", mount.roll_rad, TWIST_RANGE_RAD),
        ("yaw_rad against the board", mount.yaw_rad, TWIST_RANGE_RAD),
    ):
        if not low <= value <= high:
            raise ConfigError(f"camera {what}: expected {low:.2f} to {high:.2f}, got {value:.3f}")
    off_m = (mount.forward_m - before.forward_m, mount.left_m - before.left_m)
    if max(map(abs, off_m)) > PLACE_TOLERANCE_M:
        raise ConfigError(
            f"camera: the board lies {-1e3 * off_m[0]:.0f} mm farther and {-1e3 * off_m[1]:.0f} mm "
            f"more to the left than told, expected {1e3 * PLACE_TOLERANCE_M:.0f} mm at most; "
            "measure again from the axle, or mend camera.mount.forward_m"
        )
    return mount, residual_px
