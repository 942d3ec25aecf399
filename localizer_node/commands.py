"""``run`` and ``locate``, and what they write and draw."""

from __future__ import annotations

import argparse
import json
import math
import sys
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Dict, Iterable, List, Optional, Tuple

import numpy as np

from localizer_node.calibration import Calibration, load_calibration
from localizer_node.detect import Detection
from localizer_node.node import Localizer, PosePublisher, Publish, locate_frame
from localizer_node.rectify import Rectifier, map_outline
from localizer_node.sources import open_source
from localizer_node.track import RobotPose
from robot import output
from robot.camera.replay import read_picture
from robot.link.config import LinkConfig
from robot.output import write_png
from robot.typed_config import load_yaml, to_plain

SCHEMA = 1
STDOUT = "-"


def write_json(target: str, plain: Dict[str, Any]) -> None:
    """JSON to a file, whole or not at all, or to standard output for ``-``."""
    if target == STDOUT:
        sys.stdout.write(json.dumps(plain, indent=1) + "\n")
        return
    output.write_json(Path(target), plain)


def expect_outputs(*targets: Optional[str], inputs: Dict[str, Any]) -> None:
    """Make sure, before the work, that these files can be written; ConfigError if not."""
    files = (Path(target) for target in targets if target not in (None, STDOUT))
    output.expect_writable(*files, inputs=[Path(each) for each in inputs.values() if each])


Rgb = Tuple[int, int, int]
OUTLINE_RGB: Rgb = (250, 210, 60)
FOUND_RGB: Rgb = (60, 230, 110)
NAMELESS_RGB: Rgb = (240, 90, 80)
ARROW_M = 0.18


def annotated(
    image: np.ndarray, calibration: Calibration, detections: Iterable[Detection]
) -> np.ndarray:
    """A copy of the raw RGB picture with the map's edge and each robot's place and heading."""
    import cv2

    picture = image.copy()
    rectifier = Rectifier(calibration)
    edge = np.round(rectifier.to_pixels(map_outline(calibration.map_size_m))).astype(np.int32)
    cv2.polylines(picture, [edge.reshape(-1, 1, 2)], True, OUTLINE_RGB, 1, cv2.LINE_AA)
    heights = {m.robot: m.board.height_m for m in calibration.robots}
    for found in detections:
        _draw(picture, rectifier, found, heights.get(found.robot, 0.0))
    return picture


def _draw(picture: np.ndarray, rectifier: Rectifier, found: Detection, height_m: float) -> None:
    import cv2

    colour = FOUND_RGB if found.robot else NAMELESS_RGB
    start = (round(found.u_px), round(found.v_px))
    cv2.circle(picture, start, 4, colour, 2, cv2.LINE_AA)
    if found.heading_rad is not None:
        ahead = np.array([math.cos(found.heading_rad), math.sin(found.heading_rad)])
        tip = rectifier.to_pixels(np.array([found.x_m, found.y_m]) + ARROW_M * ahead, height_m)
        end = (round(float(tip[0])), round(float(tip[1])))
        cv2.arrowedLine(picture, start, end, colour, 2, cv2.LINE_AA, tipLength=0.25)
    degrees = "?" if found.heading_rad is None else f"{math.degrees(found.heading_rad):.0f}"
    label = f"{found.robot or 'unread'} {found.x_m:.2f} {found.y_m:.2f} {degrees}"
    where = (start[0] + 14, start[1] - 14)
    cv2.putText(picture, label, where, cv2.FONT_HERSHEY_SIMPLEX, 0.5, (0, 0, 0), 3, cv2.LINE_AA)
    cv2.putText(picture, label, where, cv2.FONT_HERSHEY_SIMPLEX, 0.5, colour, 1, cv2.LINE_AA)


def run(arguments: argparse.Namespace) -> None:
    """Follow the robots until the source ends; publish their poses, or print them as JSON lines."""
    calibration = load_calibration(arguments.calibration)
    frames = open_source(arguments.source, calibration.lens, arguments.fps)
    with ExitStack() as open_links:
        publish: Publish = _print_lines
        if arguments.link:
            link = PosePublisher(load_yaml(LinkConfig, arguments.link))
            publish = open_links.enter_context(link)
        localizer = Localizer(calibration, publish)
        for frame in frames:
            localizer.feed(frame.image, frame.t_capture_s)


def _print_lines(poses: Tuple[RobotPose, ...]) -> None:
    for pose in poses:
        print(json.dumps(to_plain(pose)), flush=True)


def locate(arguments: argparse.Namespace) -> None:
    """Find the robots in one picture, and tell or draw them."""
    inputs = {"image": arguments.image, "calibration": arguments.calibration}
    expect_outputs(arguments.json, arguments.picture, inputs=inputs)
    image = read_picture(Path(arguments.image))
    calibration = load_calibration(arguments.calibration)
    found = locate_frame(image, calibration)
    if arguments.picture:
        write_png(Path(arguments.picture), annotated(image, calibration, found))
    if arguments.json:
        write_json(arguments.json, _located(found, inputs))
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
