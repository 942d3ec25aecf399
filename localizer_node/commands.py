"""``run`` and ``locate``, and what they write."""

from __future__ import annotations

import argparse
import json
import math
import sys
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Dict, List, Optional, Tuple

from localizer_node.calibration import load_calibration
from localizer_node.detect import Detection
from localizer_node.draw import annotated
from localizer_node.node import Localizer, Publish, locate_frame
from localizer_node.sources import open_source
from localizer_node.track import RobotPose
from robot import output
from robot.camera.files import read_picture
from robot.link.config import LinkConfig
from robot.link.messages import PosesMessage, Sighting
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


def run(arguments: argparse.Namespace) -> None:
    """Follow the robots until the source ends; publish their poses, or print them as JSON lines."""
    calibration = load_calibration(arguments.calibration)
    frames = open_source(arguments.source, calibration.lens, arguments.fps)
    with ExitStack() as open_links:
        publish: Publish = _print_lines
        if arguments.link:
            publish = publisher(load_yaml(LinkConfig, arguments.link), open_links)
        localizer = Localizer(calibration, publish)
        for frame in frames:
            localizer.feed(frame.image, frame.t_capture_s)


def publisher(config: LinkConfig, stack: ExitStack) -> Publish:
    """What tells robots and monitor the poses of each picture, as long as the stack is open.

    Raises:
        ConfigError: the link's keys are absent, or the configuration does not fit.
    """
    link = config.open()
    stack.callback(link.close)
    channel = config.publisher(link, PosesMessage)

    def publish(poses: Tuple[RobotPose, ...]) -> None:
        link.admit()
        if poses:
            channel.send(message_of(poses))

    return publish


def message_of(poses: Tuple[RobotPose, ...]) -> PosesMessage:
    """The message that tells the poses of one picture, of which there is at least one."""
    seen = tuple(Sighting(p.robot, p.x_m, p.y_m, p.heading_rad, p.confidence) for p in poses)
    return PosesMessage(seen, poses[0].t_capture_s)


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
        print(f"{one.robot}: x {one.x_m:.3f} m, y {one.y_m:.3f} m, heading {heading} degrees")
    if not found:
        print("no robot found")


def _located(found: List[Detection], inputs: Dict[str, str]) -> Dict[str, Any]:
    best = to_plain(found[0]) if found else {"confidence": 0.0}
    keys = ("robot", "x_m", "y_m", "heading_rad", "confidence")
    return {
        "schema": SCHEMA,
        "inputs": inputs,
        "found": bool(found),
        **{key: best.get(key) for key in keys},
        "robots": [to_plain(d) for d in found],
    }
