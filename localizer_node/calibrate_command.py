"""``calibrate``."""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import Tuple

from localizer_node.calibrate import KnownPoint, Report, calibrate, corner_points, guess_lens
from localizer_node.calibration import Marker, save_calibration
from localizer_node.draw import annotated
from robot.bringup.camera_place import Freedom
from robot.camera.files import read_picture
from robot.command_line import number, pair
from robot.errors import ConfigError
from robot.lens import MODELS, Lens
from robot.navigation.road_map import load_map
from robot.output import expect_writable, write_png
from robot.typed_config import load_yaml

DISTORTION_POINTS = 8  # from so many points on, the lens' first coefficient is fitted too


@dataclass(frozen=True)
class PointsFile:
    """What a person writes for ``--points``: floor points, and the pixels that show them."""

    points: Tuple[KnownPoint, ...]


@dataclass(frozen=True)
class RobotsFile:
    """What a person writes for ``--robots``."""

    robots: Tuple[Marker, ...]


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
    parser.add_argument(
        "--height", type=number(0.1, 20.0), help="of the camera above the floor, measured [m]"
    )
    parser.add_argument("--map", default="arena", help="road map whose floor this is")
    parser.add_argument("--robots", help="YAML with `robots:`, a list of markers")
    parser.set_defaults(command=make)


def make(arguments: argparse.Namespace) -> None:
    """Calibrate, write the file, and say how good it is.

    ConfigError: whatever is wrong with points, lens, colours or result.
    """
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
    save_calibration(report.calibration, arguments.out)
    if arguments.picture:
        write_png(arguments.picture, annotated(image, report.calibration, ()))
    _tell(report, arguments.out)


def _lens(name: str, width_px: int, height_px: int) -> Tuple[Lens, bool]:
    """The lens to start from, and whether it is known already."""
    if name in MODELS or not Path(name).is_file():
        return guess_lens(name, width_px, height_px), False
    lens = load_yaml(Lens, name)
    if lens.width_px * height_px != lens.height_px * width_px:
        raise ConfigError(
            f"{name}: lens of a {lens.width_px}x{lens.height_px} picture; expected the same shape "
            f"as {width_px}x{height_px}"
        )
    return lens.scaled(width_px, height_px), True


def _tell(report: Report, out: Path) -> None:
    x, y, height = report.calibration.camera_m
    print(f"{out}: residual {report.calibration.residual_mm:.1f} mm RMS", end=", ")
    print(f"camera {height:.2f} m above ({x:.2f}, {y:.2f}) m", end=", ")
    print(f"parallax uncertain by {report.parallax_sigma_mm:.1f} mm at most")
    if not report.checked:
        print("so few points fit almost any lens: add the map's middle and edges to check it")
