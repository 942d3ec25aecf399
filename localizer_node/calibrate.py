"""Make a ``Calibration`` from points of the floor whose pixels are known; refuse a bad one."""

import argparse
import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import List, NamedTuple, Sequence, Tuple

import numpy as np

from localizer_node.calibration import Calibration, Marker, map_corners, map_outline
from robot.bringup.camera_place import CameraFit, Freedom, fit_camera
from robot.camera.files import read_picture, write_png
from robot.command_line import number, pair
from robot.errors import ConfigError
from robot.lens import MODELS, Hanging, Lens
from robot.navigation.road_map import load_map
from robot.output import expect_writable, write_yaml
from robot.typed_config import load_yaml

DISTORTION_POINTS = 8  # from so many points on, the lens' first coefficient is fitted too
MAX_RESIDUAL_MM = 8.0
ENOUGH_SPARE = 4  # equations beyond the unknowns: with fewer, a wrong lens leaves no residual
MAX_PARALLAX_ERROR_MM = 10.0
ROI_MARGIN_M = 0.08


@dataclass(frozen=True)
class KnownPoint:
    """One floor point and where the picture shows it."""

    u_px: float
    v_px: float
    x_m: float
    y_m: float


@dataclass(frozen=True)
class PointsFile:
    """What a person writes for ``--points``."""

    points: Tuple[KnownPoint, ...]


@dataclass(frozen=True)
class RobotsFile:
    """What a person writes for ``--robots``."""

    robots: Tuple[Marker, ...]


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
        order = "south-west, south-east, north-east, north-west"
        raise ConfigError(f"expected four --corner U,V ({order}), got {len(pixels)}")
    corners = map_corners(map_size_m).tolist()
    return [KnownPoint(*pixel, *corner) for pixel, corner in zip(pixels, corners)]


def guess_lens(model: str, width_px: int, height_px: int) -> Lens:
    """A lens of this model, 100 degrees across, to be improved; ConfigError: no such model."""
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
    hanging = Hanging.of(fit.position_m, fit.rotation.T)
    rough = Calibration(fit.lens, hanging, map_size_m=map_size_m, robots=robots)
    errors = np.linalg.norm(rough.camera.to_floor(pixels) - floor_m, axis=1) * 1000.0
    residual = float(np.sqrt(np.mean(errors**2)))
    if residual > max_residual_mm:
        worst = int(np.argmax(errors))
        raise ConfigError(
            f"calibration: expected a residual of at most {max_residual_mm:g} mm RMS, got "
            f"{residual:.1f} mm; the worst is point {worst + 1} with {errors[worst]:.1f} mm: check "
            "its pixel and its place, then the map's size and the lens model (fisheye or pinhole)"
        )
    tallest_m = max([0.0, *(m.board.height_m for m in robots)])
    parallax = _parallax_sigma_mm(fit, map_size_m, tallest_m)
    calibration = replace(rough, residual_mm=residual, roi_px=_roi(rough, tallest_m))
    return Report(calibration, parallax, 2 * len(points) - freedom.unknowns >= ENOUGH_SPARE)


def _check_points(pixels: np.ndarray, floor_m: np.ndarray, lens: Lens) -> None:
    if len(pixels) < 4:
        raise ConfigError(f"calibration: expected at least 4 points, got {len(pixels)}")
    size = (lens.width_px, lens.height_px)
    for i, (u, v) in enumerate(pixels):
        if not (-0.5 <= u <= size[0] - 0.5 and -0.5 <= v <= size[1] - 0.5):
            told = f"outside the {size[0]}x{size[1]} picture; expected a point that the camera sees"
            raise ConfigError(f"calibration: point {i + 1} at ({u:g}, {v:g}) px lies {told}")
    for what, values in (("pixels", pixels), ("floor points", floor_m)):
        if _almost_collinear(values):
            told = f"calibration: all but one of the {what} lie almost on one line; "
            raise ConfigError(f"{told}expected four corners of an area, spread over the arena")


def _almost_collinear(points: np.ndarray) -> bool:
    """Whether some line passes all points but at most one, to 3 % of their extent."""
    rests = (np.delete(points, left_out, axis=0) for left_out in range(len(points)))
    spreads = (np.linalg.svd(rest - rest.mean(axis=0), compute_uv=False) for rest in rests)
    return any(spread[1] <= 0.03 * max(spread[0], 1e-12) for spread in spreads)


def _parallax_sigma_mm(fit: CameraFit, map_size_m: Tuple[float, float], tallest_m: float) -> float:
    reach = np.linalg.norm(map_corners(map_size_m) - fit.position_m[:2], axis=1).max()
    sigma_mm = float(1000.0 * reach * tallest_m * fit.height_sigma_m / fit.position_m[2] ** 2)
    if sigma_mm > MAX_PARALLAX_ERROR_MM:
        raise ConfigError(
            f"calibration: the camera's height comes out as {fit.position_m[2]:.2f} m +- "
            f"{fit.height_sigma_m:.2f} m, so that a board could be misplaced by {sigma_mm:.0f} mm "
            f"(expected at most {MAX_PARALLAX_ERROR_MM:g}); measure the height and give it, "
            "or give the lens, or more points"
        )
    return sigma_mm


def _roi(calibration: Calibration, height_m: float) -> Tuple[Tuple[float, float], ...]:
    """The picture of the map and ``ROI_MARGIN_M`` around it, on the floor and at board height."""
    import cv2

    outline = map_outline(calibration.map_size_m)
    middle = np.array(calibration.map_size_m) / 2.0
    outline = middle + (outline - middle) * (1.0 + ROI_MARGIN_M / middle)
    both = np.concatenate([calibration.to_pixels(outline, h) for h in (0.0, height_m)])
    if not np.isfinite(both).all():  # beyond what the lens sees: the whole picture
        return ()
    lens = calibration.lens
    inside = np.clip(both, (0.0, 0.0), (lens.width_px - 1.0, lens.height_px - 1.0))
    hull = cv2.convexHull(np.round(inside).astype(np.int32)).reshape(-1, 2)
    return tuple((float(u), float(v)) for u, v in hull)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of ``calibrate``."""
    parser.add_argument("--out", type=Path, required=True, help="the calibration file to write")
    parser.add_argument("--image", type=Path, required=True, help="a picture of the camera")
    parser.add_argument("--picture", type=Path, metavar="PNG", help="draw the map's edge into it")
    parser.add_argument("--points", help="YAML of known points (see docs/localizer.md)")
    parser.add_argument(
        "--corner",
        type=pair("U,V such as 208.5,644"),
        action="append",
        default=[],
        metavar="U,V",
        help="pixel of a map corner, four times: south-west, south-east, north-east, north-west",
    )
    parser.add_argument("--lens", default="fisheye", help=f"{', '.join(MODELS)}, or a lens file")
    parser.add_argument("--height", type=number(0.1, 20.0), help="of the camera, measured [m]")
    parser.add_argument("--map", default="arena", help="road map whose floor this is")
    parser.add_argument("--robots", help="YAML with `robots:`, a list of markers")
    parser.set_defaults(command=make)


def make(arguments: argparse.Namespace) -> None:
    """Calibrate, write the file, and say how good it is; ConfigError for whatever is wrong."""
    named = (arguments.points, arguments.robots, arguments.lens, arguments.map)
    inputs = [arguments.image, *(Path(name) for name in named if name)]
    expect_writable(arguments.out, arguments.picture, inputs=inputs)
    image = read_picture(arguments.image)
    size = (image.shape[1], image.shape[0])
    road_map = load_map(arguments.map)
    map_size_m = (road_map.width_m, road_map.height_m)
    if arguments.points:
        points = list(load_yaml(PointsFile, arguments.points).points)
    else:
        points = corner_points(arguments.corner, map_size_m)
    lens, known = _lens(arguments.lens, *size)
    distortion = int(not known and lens.model != "pinhole" and len(points) >= DISTORTION_POINTS)
    freedom = Freedom(not known, distortion, arguments.height)
    robots = load_yaml(RobotsFile, arguments.robots).robots if arguments.robots else (Marker(),)
    report = calibrate(points, lens, freedom, map_size_m, robots)
    write_yaml(arguments.out, report.calibration)
    if arguments.picture:
        from localizer_node.detect import annotated

        write_png(arguments.picture, annotated(image, report.calibration, ()))
    x, y, height = report.calibration.hanging.position_m
    print(f"{arguments.out}: residual {report.calibration.residual_mm:.1f} mm RMS", end=", ")
    print(f"camera {height:.2f} m above ({x:.2f}, {y:.2f}) m", end=", ")
    print(f"parallax uncertain by {report.parallax_sigma_mm:.1f} mm at most")
    if not report.checked:
        print("so few points fit almost any lens: add the map's middle and edges to check it")


def _lens(name: str, width_px: int, height_px: int) -> Tuple[Lens, bool]:
    """The lens to start from, and whether it is known already."""
    if name in MODELS or not Path(name).is_file():
        return guess_lens(name, width_px, height_px), False
    return load_yaml(Lens, name).of_picture(width_px, height_px), True
