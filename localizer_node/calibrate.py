"""Make a ``Calibration`` from points of the floor whose pixels are known; refuse a bad one."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import List, NamedTuple, Sequence, Tuple

import numpy as np

from localizer_node.calibration import Board, Calibration, Marker
from localizer_node.rectify import Rectifier, map_outline
from robot.bringup.camera_place import CameraFit, Freedom, fit_camera
from robot.errors import ConfigError
from robot.lens import Lens

MAX_RESIDUAL_MM = 8.0
ENOUGH_SPARE = 4
MAX_PARALLAX_ERROR_MM = 10.0
ROI_MARGIN_M = 0.08


@dataclass(frozen=True)
class KnownPoint:
    """One floor point and where the picture shows it."""

    u_px: float
    v_px: float
    x_m: float
    y_m: float


class Report(NamedTuple):
    """A calibration and how good it is."""

    calibration: Calibration
    parallax_sigma_mm: float  # of a board in the farthest corner, from the height's uncertainty
    checked: bool  # points enough for the residual to show a wrong lens or place


def corner_points(
    pixels: Sequence[Tuple[float, float]], map_size_m: Tuple[float, float]
) -> List[KnownPoint]:
    """The map's corners, in the order of ``map_corners``; ConfigError unless four are given."""
    if len(pixels) != 4:
        raise ConfigError(
            "expected four --corner U,V (south-west, south-east, north-east, north-west), "
            f"got {len(pixels)}"
        )
    corners = map_corners(map_size_m)
    return [KnownPoint(u, v, float(x), float(y)) for (u, v), (x, y) in zip(pixels, corners)]


def map_corners(map_size_m: Tuple[float, float]) -> np.ndarray:
    """(4, 2) [m]: south-west, south-east, north-east, north-west."""
    return np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]) * np.array(map_size_m)


def guess_lens(model: str, width_px: int, height_px: int) -> Lens:
    """A lens of this model that sees 100 degrees across, for ``calibrate`` to improve.

    ConfigError: no such model, with the nearest one.
    """
    half = math.radians(50.0)
    focal = (width_px / 2.0) / (half if model == "fisheye" else math.tan(half))
    count = {"fisheye": 4, "plumb_bob": 5}.get(model, 0)
    centre = ((width_px - 1) / 2.0, (height_px - 1) / 2.0)
    return Lens(model, width_px, height_px, focal, focal, *centre, (0.0,) * count)


def calibrate(
    points: Sequence[KnownPoint],
    lens: Lens,
    freedom: Freedom = Freedom(focal=True),  # noqa: B008 (frozen)
    map_size_m: Tuple[float, float] = (2.2, 2.64),
    robots: Tuple[Marker, ...] = (Marker(),),
    max_residual_mm: float = MAX_RESIDUAL_MM,
) -> Report:
    """Find the camera (and what ``freedom`` leaves open of its lens) from at least four points.

    ConfigError: fewer than four points, points outside the picture or on one line, a residual above
    ``max_residual_mm`` (naming the worst point), or a camera height so uncertain that the boards'
    parallax would be wrong by more than ``MAX_PARALLAX_ERROR_MM``.
    """
    pixels = np.array([(p.u_px, p.v_px) for p in points], dtype=float).reshape(-1, 2)
    floor_m = np.array([(p.x_m, p.y_m) for p in points], dtype=float).reshape(-1, 2)
    _check_points(pixels, floor_m, lens)
    fit = fit_camera(pixels, floor_m, lens, freedom)
    rough = replace(_calibration_of(fit, map_size_m), robots=robots)
    errors = np.linalg.norm(Rectifier(rough).to_floor(pixels) - floor_m, axis=1) * 1000.0
    residual = float(np.sqrt(np.mean(errors**2)))
    if residual > max_residual_mm:
        worst = int(np.argmax(errors))
        raise ConfigError(
            f"calibration: expected a residual of at most {max_residual_mm:g} mm RMS, got "
            f"{residual:.1f} mm; the worst is point {worst + 1} with {errors[worst]:.1f} mm: check "
            "its pixel and its place, then the map's size and the lens model (fisheye or pinhole)"
        )
    parallax = _parallax_sigma_mm(fit, map_size_m, [m.board for m in robots])
    roi = _roi(rough, max([0.0, *(m.board.height_m for m in robots)]))
    calibration = replace(rough, residual_mm=residual, roi_px=roi)
    # Equations beyond the unknowns: with few, a wrong lens leaves no residual either.
    checked = 2 * len(points) - freedom.unknowns >= ENOUGH_SPARE
    return Report(calibration, parallax, checked)


def _check_points(pixels: np.ndarray, floor_m: np.ndarray, lens: Lens) -> None:
    if len(pixels) < 4:
        raise ConfigError(
            f"calibration: expected at least 4 points, got {len(pixels)}; "
            "the four corners of the map will do"
        )
    size = (lens.width_px, lens.height_px)
    for i, (u, v) in enumerate(pixels):
        if not (-0.5 <= u <= size[0] - 0.5 and -0.5 <= v <= size[1] - 0.5):
            raise ConfigError(
                f"calibration: point {i + 1} at ({u:g}, {v:g}) px lies outside the "
                f"{size[0]}x{size[1]} picture; expected a point that the camera sees"
            )
    for what, values in (("pixels", pixels), ("floor points", floor_m)):
        if _almost_collinear(values):
            raise ConfigError(
                f"calibration: all but one of the {what} lie almost on one line; "
                "expected four corners of an area, spread over the arena"
            )


def _almost_collinear(points: np.ndarray) -> bool:
    """Whether some line passes all points but at most one, to 3 % of their extent."""
    rests = (np.delete(points, left_out, axis=0) for left_out in range(len(points)))
    spreads = (np.linalg.svd(rest - rest.mean(axis=0), compute_uv=False) for rest in rests)
    return any(spread[1] <= 0.03 * max(spread[0], 1e-12) for spread in spreads)


def _parallax_sigma_mm(
    fit: CameraFit, map_size_m: Tuple[float, float], boards: Sequence[Board]
) -> float:
    reach = np.linalg.norm(map_corners(map_size_m) - fit.position_m[:2], axis=1).max()
    tallest = max([board.height_m for board in boards], default=0.0)
    sigma_mm = float(1000.0 * reach * tallest * fit.height_sigma_m / fit.position_m[2] ** 2)
    if sigma_mm > MAX_PARALLAX_ERROR_MM:
        raise ConfigError(
            f"calibration: the camera's height comes out as {fit.position_m[2]:.2f} m +- "
            f"{fit.height_sigma_m:.2f} m, so that a board could be misplaced by {sigma_mm:.0f} mm "
            f"(expected at most {MAX_PARALLAX_ERROR_MM:g}); measure the height and give it, "
            "or give the lens, or more points"
        )
    return sigma_mm


def _calibration_of(fit: CameraFit, map_size_m: Tuple[float, float]) -> Calibration:
    east = fit.rotation[:, 0]
    turn = -math.atan2(east[1], east[0])
    c, s = math.cos(turn), math.sin(turn)
    turned = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ fit.ray_from_floor
    homography = np.linalg.inv(turned)
    homography = homography / homography[2, 2]
    x, y, height = (float(v) for v in fit.position_m)
    return Calibration(
        lens=fit.lens,
        homography=tuple(float(v) for v in homography.ravel()),
        camera_m=(x, y, height),
        rotation_rad=turn,
        map_size_m=map_size_m,
        robots=(),
    )


def _roi(calibration: Calibration, height_m: float) -> Tuple[Tuple[float, float], ...]:
    """The picture of the map and ``ROI_MARGIN_M`` around it, on the floor and at board height."""
    import cv2

    outline = map_outline(calibration.map_size_m)
    middle = np.array(calibration.map_size_m) / 2.0
    outline = middle + (outline - middle) * (1.0 + ROI_MARGIN_M / middle)
    rectifier = Rectifier(calibration)
    both = np.concatenate([rectifier.to_pixels(outline, h) for h in (0.0, height_m)])
    lens = calibration.lens
    inside = np.clip(both, (0.0, 0.0), (lens.width_px - 1.0, lens.height_px - 1.0))
    hull = cv2.convexHull(np.round(inside).astype(np.int32)).reshape(-1, 2)
    return tuple((float(u), float(v)) for u, v in hull)
