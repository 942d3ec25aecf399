"""The lens from pictures of the printed chessboard, held at many angles."""

from __future__ import annotations

from typing import List, NamedTuple, Sequence, Tuple

import numpy as np

from robot.bringup.target import COLUMNS, ROWS, board_points_m
from robot.errors import ConfigError
from robot.lens import Lens

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
