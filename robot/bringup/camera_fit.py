"""The lens and its mount from pictures of the printed chessboard."""

from __future__ import annotations

import math
from typing import List, NamedTuple, Sequence, Tuple

import numpy as np

from robot.bringup.chessboard import COLUMNS, ROWS, board_points_m
from robot.errors import ConfigError
from robot.lens import CameraRig, Lens, Mount

FEWEST_PICTURES = 8
MOST_RESIDUAL_PX = 1.0  # of a picture 640 pixels wide
LEAST_COVERAGE = 0.6  # of the picture's width and height that boards were seen in
FOCAL_RANGE = (0.2, 3.0)  # focal length over width: 260 to 19 degrees


class LensFit(NamedTuple):
    """A fisheye lens, and by how much the corners miss it."""

    lens: Lens
    residual_px: float
    coverage: Tuple[float, float]  # across and along


def fit_lens(boards_px: Sequence[np.ndarray], size_px: Tuple[int, int]) -> LensFit:
    """The equidistant lens (Kannala and Brandt 2006) that saw the boards.

    Args:
        boards_px: (28, 2) corners of each picture.
        size_px: width and height of the pictures.

    Raises:
        ConfigError: too few pictures, a bad fit, or a lens that cannot be.
    """
    if len(boards_px) < FEWEST_PICTURES:
        raise ConfigError(
            f"lens: expected {FEWEST_PICTURES} pictures or more in which the board is seen, got "
            f"{len(boards_px)}; hold it still, whole in the picture, in even light"
        )
    every = np.concatenate(list(boards_px))
    spread = np.ptp(every, axis=0) / size_px
    coverage = (float(spread[0]), float(spread[1]))
    if min(coverage) < LEAST_COVERAGE:
        raise ConfigError(
            f"lens: the boards cover {100 * coverage[0]:.0f} % of the width and "
            f"{100 * coverage[1]:.0f} % of the height, expected {100 * LEAST_COVERAGE:.0f} % each; "
            "hold the board into every corner of the picture"
        )
    lens, residual_px = _calibrate(list(boards_px), size_px)
    most_px = MOST_RESIDUAL_PX * size_px[0] / 640.0
    if not residual_px <= most_px:
        raise ConfigError(
            f"lens: the corners miss the fitted lens by {residual_px:.2f} px, expected at most "
            f"{most_px:.2f}; is the sheet flat, are the pictures sharp and all of one size?"
        )
    centred = 0.25 < lens.cx_px / size_px[0] < 0.75 and 0.25 < lens.cy_px / size_px[1] < 0.75
    if not (centred and FOCAL_RANGE[0] <= lens.fx_px / size_px[0] <= FOCAL_RANGE[1]):
        raise ConfigError(
            f"lens: expected a centre in the middle and a plausible focal length, got "
            f"({lens.cx_px:.0f}, {lens.cy_px:.0f}) and {lens.fx_px:.0f} px (residual "
            f"{residual_px:.2f} px); take pictures at more angles"
        )
    return LensFit(lens, residual_px, coverage)


def _calibrate(boards_px: List[np.ndarray], size_px: Tuple[int, int]) -> Tuple[Lens, float]:
    import cv2

    board = board_points_m(0.0)[:, None, :]
    width, height = size_px
    guess = np.array([[0.5 * width, 0.0, 0.5 * width], [0.0, 0.5 * width, 0.5 * height], [0, 0, 1]])
    flags = (
        cv2.fisheye.CALIB_RECOMPUTE_EXTRINSIC
        | cv2.fisheye.CALIB_FIX_SKEW
        | cv2.fisheye.CALIB_USE_INTRINSIC_GUESS
    )
    criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 200, 1e-8)
    corners = [np.ascontiguousarray(c[:, None, :]) for c in boards_px]
    try:
        residual, matrix, distortion, _, _ = cv2.fisheye.calibrate(
            [board] * len(corners),
            corners,
            size_px,
            guess,
            np.zeros(4),
            None,
            None,
            flags,
            criteria,
        )
    except cv2.error as error:
        raise ConfigError(
            f"lens: no lens fits the pictures ({error.err}); tilt the {COLUMNS} by {ROWS} board "
            "more, and take those out in which corners were mistaken"
        ) from error
    k = tuple(float(v) for v in np.ravel(distortion))
    fx, fy, cx, cy = (float(matrix[i]) for i in ((0, 0), (1, 1), (0, 2), (1, 2)))
    return Lens("fisheye", width, height, fx, fy, cx, cy, k), float(residual)


MOST_PITCH_SIGMA_RAD = math.radians(0.3)
PITCH_RANGE_RAD = (math.radians(-5.0), math.radians(60.0))
HEIGHT_RANGE_M = (0.03, 0.40)
MOST_TWIST_RAD = math.radians(12.0)  # of roll, and of yaw against the board
PLACE_TOLERANCE_M = 0.05  # of the board


class MountFit(NamedTuple):
    """The mount, how well the corners fit it, and how sure its pitch and height are."""

    mount: Mount
    residual_px: float
    pitch_sigma_rad: float
    height_sigma_m: float


def fit_mount(corners_px: np.ndarray, lens: Lens, near_edge_m: float, square_m: float) -> MountFit:
    """All six figures of the mount, by least squares of the reprojection error.

    Pitch, roll and height do not depend on where the board lies; yaw, ``forward_m`` and ``left_m``
    are as good as the board's placing.

    Args:
        corners_px: (28, 2) of `robot.bringup.chessboard.find_board`.
        lens: at the size of that picture.
        near_edge_m: as for `robot.bringup.chessboard.board_points_m`.
        square_m: side of a printed square.

    Raises:
        ConfigError: no camera can see the board so.
    """
    points_m = board_points_m(near_edge_m, square_m)
    figures = np.array(_figures(_start(corners_px, points_m, lens)))

    def misses(values: np.ndarray) -> np.ndarray:
        return (CameraRig(lens, _mount(values)).to_pixels(points_m) - corners_px).ravel()

    for _ in range(20):  # Gauss-Newton (Hartley and Zisserman, Multiple View Geometry, A6.1)
        jacobian = _jacobian(misses, figures)
        step = np.linalg.lstsq(jacobian, -misses(figures), rcond=None)[0]
        figures = figures + step
        if np.abs(step).max() < 1e-9:
            break
    errors = misses(figures)
    if not np.isfinite(errors).all():
        raise ConfigError("camera: no mount explains the corners; is the lens the right one?")
    freedom = errors.size - figures.size
    covariance = np.linalg.inv(jacobian.T @ jacobian) * float(errors @ errors) / freedom
    sigma = np.sqrt(np.diag(covariance))
    residual_px = math.sqrt(2.0 * float(np.mean(errors**2)))
    return MountFit(_mount(figures), residual_px, float(sigma[3]), float(sigma[0]))


def check_mount_fit(fit: MountFit, before: Mount, width_px: int) -> None:
    """ConfigError unless the fit is good and the mount plausible, telling the residual."""
    mount = fit.mount
    pitch_deg, roll_deg = math.degrees(mount.pitch_rad), math.degrees(mount.roll_rad)
    told = f"(residual {fit.residual_px:.2f} px)"
    if fit.residual_px > MOST_RESIDUAL_PX * width_px / 640.0:
        raise ConfigError(
            f"camera: the corners miss the fitted board by {fit.residual_px:.2f} px, expected at "
            f"most {MOST_RESIDUAL_PX * width_px / 640.0:.2f}; is the sheet flat and printed at "
            "100 %? else calibrate the lens first"
        )
    if fit.pitch_sigma_rad > MOST_PITCH_SIGMA_RAD:
        raise ConfigError(
            f"camera: the pitch is uncertain by {math.degrees(fit.pitch_sigma_rad):.2f}° {told}; "
            "move the sheet nearer, make more light"
        )
    _expect("pitch", mount.pitch_rad, PITCH_RANGE_RAD, f"{pitch_deg:.1f}° {told}")
    _expect("height", mount.height_m, HEIGHT_RANGE_M, f"{mount.height_m:.3f} m {told}")
    twist = (-MOST_TWIST_RAD, MOST_TWIST_RAD)
    _expect("roll", mount.roll_rad, twist, f"{roll_deg:.1f}° {told}")
    _expect("yaw against the board", mount.yaw_rad, twist, f"{math.degrees(mount.yaw_rad):.1f}°")
    off_m = (mount.forward_m - before.forward_m, mount.left_m - before.left_m)
    if max(map(abs, off_m)) > PLACE_TOLERANCE_M:
        raise ConfigError(
            f"camera: the board lies {-1e3 * off_m[0]:.0f} mm farther and {-1e3 * off_m[1]:.0f} mm "
            f"more to the left than told, expected {1e3 * PLACE_TOLERANCE_M:.0f} mm at most; "
            "measure again from the axle, or mend camera.mount.forward_m"
        )


def _expect(what: str, value: float, within: Tuple[float, float], got: str) -> None:
    if not within[0] <= value <= within[1]:
        limits = [f"{math.degrees(v):.0f}°" if "°" in got else f"{v:g} m" for v in within]
        raise ConfigError(f"camera {what}: expected {limits[0]} to {limits[1]}, got {got}")


def _figures(mount: Mount) -> Tuple[float, ...]:
    place = (mount.height_m, mount.forward_m, mount.left_m)
    return (*place, mount.pitch_rad, mount.yaw_rad, mount.roll_rad)


def _mount(figures: np.ndarray) -> Mount:
    return Mount(*(float(value) for value in figures))


def _jacobian(misses: object, figures: np.ndarray) -> np.ndarray:
    assert callable(misses)
    step = 1e-6
    columns = [
        (misses(figures + e) - misses(figures - e)) / (2.0 * step)
        for e in step * np.eye(len(figures))
    ]
    return np.stack(columns, axis=1)


def _start(corners_px: np.ndarray, points_m: np.ndarray, lens: Lens) -> Mount:
    """The pose of the board in undistorted coordinates."""
    import cv2

    rays = lens.unproject(corners_px)
    plane = rays[:, :2] / rays[:, 2:]
    found, turn, shift = cv2.solvePnP(points_m, plane, np.eye(3), None, flags=cv2.SOLVEPNP_IPPE)
    if not found:
        raise ConfigError("camera: no camera sees the board so; is it the printed sheet?")
    rotation = cv2.Rodrigues(turn)[0]  # robot frame to camera frame
    left_m, height_m = (float(v) for v in (-rotation.T @ shift).ravel()[1:])
    forward_m = float((-rotation.T @ shift).ravel()[0])
    matrix = rotation.T @ Mount(pitch_rad=0.0).rotation.T
    pitch_rad = math.asin(max(-1.0, min(1.0, -float(matrix[2, 0]))))
    yaw_rad = math.atan2(float(matrix[1, 0]), float(matrix[0, 0]))
    roll_rad = math.atan2(float(matrix[2, 1]), float(matrix[2, 2]))
    return Mount(height_m, forward_m, left_m, pitch_rad, yaw_rad, roll_rad)
