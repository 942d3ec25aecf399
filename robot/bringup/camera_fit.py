"""The lens and its mount from pictures of the printed chessboard."""

from __future__ import annotations

import math
from typing import NamedTuple, Sequence, Tuple

import numpy as np

from robot.bringup.camera_place import Freedom, fit_camera
from robot.bringup.chessboard import COLUMNS, ROWS, board_points_m
from robot.errors import ConfigError
from robot.lens import CameraRig, Lens, Mount

FEWEST_PICTURES = 8
MOST_RESIDUAL_PX = 1.0  # of a picture 640 pixels wide
LEAST_COVERAGE = 0.6  # of the picture's width and height that boards were seen in


def fit_lens(boards_px: Sequence[np.ndarray], size_px: Tuple[int, int]) -> Tuple[Lens, float]:
    """The equidistant lens (Kannala and Brandt 2006) that saw the boards, and its residual [px].

    From boards (28, 2) in pictures of this size.

    ConfigError: too few pictures, boards in the middle only, or a bad fit.
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


PITCH_RANGE_RAD = (math.radians(-5.0), math.radians(60.0))
HEIGHT_RANGE_M = (0.03, 0.40)
TWIST_RANGE_RAD = (-math.radians(12.0), math.radians(12.0))  # of roll, and yaw against the board
PLACE_TOLERANCE_M = 0.05  # of the board


class MountFit(NamedTuple):
    """The mount, and how well the corners fit it."""

    mount: Mount
    residual_px: float


def fit_mount(corners_px: np.ndarray, lens: Lens, near_edge_m: float) -> MountFit:
    """All six figures of the mount, by least squares of the reprojection error.

    From corners (28, 2) of `robot.bringup.chessboard.find_board`, and the lens at that picture's
    size. Pitch, roll and height do not depend on where the board lies; yaw, ``forward_m`` and
    ``left_m`` are as good as the board's placing. ConfigError: no camera can see the board so.
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
    return MountFit(mount, float(np.sqrt(np.mean(np.sum(misses_px**2, axis=1)))))


def check_mount_fit(fit: MountFit, before: Mount, width_px: int) -> None:
    """ConfigError unless the fit is good and the mount plausible, telling the residual."""
    mount, most_px = fit.mount, MOST_RESIDUAL_PX * width_px / 640.0
    if fit.residual_px > most_px:
        raise ConfigError(
            f"camera: the corners miss the fitted board by {fit.residual_px:.2f} px, expected at "
            f"most {most_px:.2f}; is the sheet flat and printed at 100 %? else calibrate the lens "
            "first"
        )
    for what, value, (low, high) in (
        ("height_m", mount.height_m, HEIGHT_RANGE_M),
        ("pitch_rad", mount.pitch_rad, PITCH_RANGE_RAD),
        ("roll_rad", mount.roll_rad, TWIST_RANGE_RAD),
        ("yaw_rad against the board", mount.yaw_rad, TWIST_RANGE_RAD),
    ):
        if not low <= value <= high:
            raise ConfigError(
                f"camera {what}: expected {low:.2f} to {high:.2f}, got {value:.3f} "
                f"(residual {fit.residual_px:.2f} px)"
            )
    off_m = (mount.forward_m - before.forward_m, mount.left_m - before.left_m)
    if max(map(abs, off_m)) > PLACE_TOLERANCE_M:
        raise ConfigError(
            f"camera: the board lies {-1e3 * off_m[0]:.0f} mm farther and {-1e3 * off_m[1]:.0f} mm "
            f"more to the left than told, expected {1e3 * PLACE_TOLERANCE_M:.0f} mm at most; "
            "measure again from the axle, or mend camera.mount.forward_m"
        )
