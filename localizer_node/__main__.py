"""``python -m localizer_node {run,calibrate,locate}``."""

from __future__ import annotations

import argparse
import json
import math
import os
import sys
from pathlib import Path
from typing import Any, Dict, List, Optional, Sequence, Tuple

from localizer_node.calibrate import MAX_RESIDUAL_MM, Report, calibrate, guess_lens
from localizer_node.calibration import Marker, load_calibration, save_calibration
from localizer_node.camera_fit import Freedom
from localizer_node.detect import Detection
from localizer_node.draw import annotated
from localizer_node.node import Localizer, locate_frame
from localizer_node.points import corner_points, read_points
from localizer_node.rectify import Rectifier
from localizer_node.sources import open_source, read_picture
from robot.errors import ConfigError, DuckpilotError, HardwareError
from robot.lens import MODELS, Lens, load_ros_calibration
from robot.link.config import LinkConfig
from robot.road_map import load_map
from robot.typed_config import from_plain, load_yaml, read_yaml, to_plain

SCHEMA = 1
DISTORTION_POINTS = 8  # from so many points on, the lens' first coefficient is fitted too


def main(argv: Optional[Sequence[str]] = None) -> int:
    """Run one command; 0 done, 2 wrong input, 1 a device that does not answer."""
    arguments = _parser().parse_args(argv)
    try:
        arguments.command(arguments)
    except DuckpilotError as error:
        print(f"localizer_node: {error}", file=sys.stderr)
        return 2
    except (HardwareError, OSError) as error:
        print(f"localizer_node: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 0
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m localizer_node", description=__doc__)
    commands = parser.add_subparsers(required=True)
    run = commands.add_parser("run", help="follow the robots and publish their poses")
    run.add_argument("--calibration", required=True)
    run.add_argument("--source", default="0", help="camera number, video file or picture folder")
    run.add_argument("--fps", type=float, default=30.0)
    run.add_argument("--link", help="YAML of the link; without it poses are printed as JSON lines")
    run.set_defaults(command=_run)
    locate = commands.add_parser("locate", help="find the robots in one picture")
    locate.add_argument("--image", required=True)
    locate.add_argument("--calibration", required=True)
    _add_outputs(locate)
    locate.set_defaults(command=_locate)
    _add_calibrate(commands.add_parser("calibrate", help="make the calibration of an arena"))
    return parser


def _add_outputs(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--json", nargs="?", const="-", metavar="OUT", help="JSON to OUT or stdout")
    parser.add_argument("--picture", metavar="PNG", help="draw what was found")


def _add_calibrate(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--out", required=True, help="the calibration file to write")
    parser.add_argument("--image", help="a picture of the camera; gives the size, shows floor tags")
    parser.add_argument("--size", type=_size, metavar="WxH", help="picture size without --image")
    parser.add_argument("--points", help="YAML of known points (see docs/localizer.md)")
    parser.add_argument(
        "--corner",
        type=_pixel,
        action="append",
        default=[],
        metavar="U,V",
        help="pixel of a map corner, four times: south-west, south-east, north-east, north-west",
    )
    parser.add_argument("--lens", default="fisheye", help=f"{', '.join(MODELS)}, or a lens file")
    parser.add_argument("--height", type=float, help="of the camera above the floor, measured [m]")
    parser.add_argument("--map", default="arena", help="road map whose floor this is")
    parser.add_argument("--robots", help="YAML with `robots:`, a list of markers")
    parser.add_argument("--max-residual-mm", type=float, default=MAX_RESIDUAL_MM)
    _add_outputs(parser)
    parser.set_defaults(command=_calibrate)


def _size(text: str) -> Tuple[int, int]:
    width, height = text.lower().split("x")
    return int(width), int(height)


def _pixel(text: str) -> Tuple[float, float]:
    u, v = text.split(",")
    return float(u), float(v)


def _run(arguments: argparse.Namespace) -> None:
    calibration = load_calibration(arguments.calibration)
    publish = None
    if arguments.link:
        from localizer_node.publish import pose_publisher

        publish = pose_publisher(load_yaml(LinkConfig, arguments.link))
    localizer = Localizer(calibration, publish)
    for frame in open_source(arguments.source, calibration.lens, arguments.fps):
        poses = localizer.feed(frame.image, frame.t_capture_s)
        if publish is None:
            for pose in poses:
                print(json.dumps(to_plain(pose)), flush=True)


def _locate(arguments: argparse.Namespace) -> None:
    image = read_picture(arguments.image)
    calibration = load_calibration(arguments.calibration)
    found = locate_frame(image, calibration)
    inputs = {"image": arguments.image, "calibration": arguments.calibration}
    if arguments.picture:
        _write_picture(arguments.picture, annotated(image, calibration, found))
    if arguments.json:
        _write_json(arguments.json, _located(found, inputs))
        return
    for one in found:
        heading = "?" if one.heading_rad is None else f"{math.degrees(one.heading_rad):.1f}"
        name = one.robot or "unread"
        print(f"{name}: x {one.x_m:.3f} m, y {one.y_m:.3f} m, heading {heading} degrees")
    if not found:
        print("no robot found")


def _located(found: List[Detection], inputs: Dict[str, str]) -> Dict[str, Any]:
    named = [d for d in found if d.robot]
    best = named[0] if named else None
    return {
        "schema": SCHEMA,
        "inputs": inputs,
        "found": best is not None,
        "robot": None if best is None else best.robot,
        "x_m": None if best is None else best.x_m,
        "y_m": None if best is None else best.y_m,
        "heading_rad": None if best is None else best.heading_rad,
        "confidence": 0.0 if best is None else best.confidence,
        "robots": [to_plain(d) for d in found],
    }


def _calibrate(arguments: argparse.Namespace) -> None:
    image = read_picture(arguments.image) if arguments.image else None
    size = arguments.size if image is None else (image.shape[1], image.shape[0])
    if size is None:
        raise ConfigError("calibrate: expected --image or --size WxH, got neither")
    road_map = load_map(arguments.map)
    map_size_m = (road_map.width_m, road_map.height_m)
    if arguments.points:
        points = read_points(arguments.points, image)
    else:
        points = corner_points(arguments.corner, map_size_m)
    lens, known = _lens(arguments.lens, *size)
    distortion = int(not known and lens.model != "pinhole" and len(points) >= DISTORTION_POINTS)
    freedom = Freedom(not known, distortion, arguments.height)
    robots = _robots(arguments.robots)
    limit = arguments.max_residual_mm
    report = calibrate(points, lens, freedom, map_size_m, robots, limit)
    save_calibration(report.calibration, arguments.out)
    if arguments.picture and image is not None:
        floor = Rectifier(report.calibration).floor_picture(image)
        _write_picture(arguments.picture, floor)
    _tell(report, arguments)


def _lens(name: str, width_px: int, height_px: int) -> Tuple[Lens, bool]:
    """The lens to start from, and whether it is known already."""
    if name in MODELS or not Path(name).is_file():
        return guess_lens(name, width_px, height_px), False
    data = read_yaml(name)
    ours = isinstance(data, dict) and "model" in data
    lens = from_plain(Lens, data, where=name) if ours else load_ros_calibration(name)
    if lens.width_px * height_px != lens.height_px * width_px:
        raise ConfigError(
            f"{name}: lens of a {lens.width_px}x{lens.height_px} picture; expected the same shape "
            f"as {width_px}x{height_px}"
        )
    return lens.scaled(width_px, height_px), True


def _robots(path: Optional[str]) -> Tuple[Marker, ...]:
    if path is None:
        return (Marker(),)
    data = read_yaml(path)
    entries = data.get("robots") if isinstance(data, dict) else None
    if not isinstance(entries, list):
        raise ConfigError(f"{path}: expected `robots:` with a list of markers")
    return tuple(from_plain(Marker, e, f"{path}: robots[{i}]") for i, e in enumerate(entries))


def _tell(report: Report, arguments: argparse.Namespace) -> None:
    if arguments.json:
        plain = {
            "schema": SCHEMA,
            "inputs": {"image": arguments.image, "points": arguments.points, "map": arguments.map},
            "residual_mm": report.residual_mm,
            "residuals_mm": list(report.residuals_mm),
            "parallax_sigma_mm": report.parallax_sigma_mm,
            "camera_m": list(report.calibration.camera_m),
        }
        _write_json(arguments.json, plain)
        return
    x, y, height = report.calibration.camera_m
    print(f"{arguments.out}: residual {report.residual_mm:.1f} mm RMS", end=", ")
    print(f"camera {height:.2f} m above ({x:.2f}, {y:.2f}) m", end=", ")
    print(f"parallax uncertain by {report.parallax_sigma_mm:.1f} mm at most")


def _write_json(target: str, plain: Dict[str, Any]) -> None:
    text = json.dumps(plain, indent=1) + "\n"
    if target == "-":
        sys.stdout.write(text)
        return
    partial = Path(target + ".part")
    partial.write_text(text, encoding="utf-8")
    os.replace(partial, target)


def _write_picture(path: str, picture: Any) -> None:
    import cv2

    if not cv2.imwrite(path, cv2.cvtColor(picture, cv2.COLOR_RGB2BGR)):
        raise ConfigError(f"{path}: expected a picture name in an existing folder (.png)")


if __name__ == "__main__":
    sys.exit(main())
