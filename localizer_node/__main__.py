"""``python -m localizer_node {run,calibrate,locate}``."""

import argparse
import json
import math
import sys
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any, Callable, Dict, List, Optional, Sequence, Tuple

from localizer_node import calibrate
from localizer_node.calibration import Calibration
from localizer_node.sources import open_source
from robot.camera.files import read_picture, write_png
from robot.command_line import OneLineParser, answer, spoken, whole
from robot.errors import ConfigError
from robot.link.messages import PosesMessage, Sighting
from robot.link.sockets import LinkConfig, Publisher
from robot.output import expect_writable, write_json
from robot.typed_config import load_yaml, to_plain

if TYPE_CHECKING:
    from localizer_node.detect import Detection

STDOUT = "-"
Publish = Callable[[Tuple[Sighting, ...], float], None]  # of poses, and when they were seen [s]


def main(argv: Optional[Sequence[str]] = None, prog: str = "python -m localizer_node") -> int:
    """Run one command; 0 done, 2 wrong input, 130 Ctrl-C, 1 a device that does not answer."""
    parser = OneLineParser(prog=prog, description=__doc__)
    actions = parser.add_subparsers(required=True, metavar="COMMAND")
    run = actions.add_parser("run", help="follow the robots and publish their poses")
    run.add_argument("--calibration", required=True)
    source = "camera number, csi, socket:PATH, video, or picture folder"
    run.add_argument("--source", default="0", help=source)
    run.add_argument("--fps", type=whole(1, 240), default=30)
    run.add_argument("--link", help="YAML of the link; without it poses are printed as JSON lines")
    run.set_defaults(command=run_command)
    locate = actions.add_parser("locate", help="find the robots in one picture")
    locate.add_argument("--image", type=Path, required=True)
    locate.add_argument("--calibration", type=Path, required=True)
    locate.add_argument("--json", nargs="?", const=STDOUT, metavar="OUT", help="to OUT or stdout")
    locate.add_argument("--picture", type=Path, metavar="PNG", help="draw what was found")
    locate.set_defaults(command=locate_command)
    calibrate.add_arguments(actions.add_parser("calibrate", help="make an arena's calibration"))
    arguments = parser.parse_args(argv)
    return answer(spoken(prog), lambda: arguments.command(arguments))


def run_command(arguments: argparse.Namespace) -> None:
    """Follow the robots until the source ends; publish their poses, or print them as JSON lines."""
    from localizer_node.node import Localizer

    calibration = load_yaml(Calibration, arguments.calibration)
    frames = open_source(arguments.source, calibration.lens, arguments.fps)
    with ExitStack() as open_links:
        publish: Publish = _print_lines
        if arguments.link:
            publish = publisher(load_yaml(LinkConfig, arguments.link), open_links)
            if Path(arguments.source).exists():  # the times of such pictures are not today's
                raise ConfigError(f"--source: expected a camera for --link, got {arguments.source}")
        localizer = Localizer(calibration)
        for frame in frames:
            publish(localizer.feed(frame.image, frame.time_s), frame.time_s)


def publisher(config: LinkConfig, stack: ExitStack) -> Publish:
    """What publishes each picture's poses; ConfigError: the link's keys are absent or wrong."""
    link = stack.enter_context(config.open())
    channel = Publisher(link, PosesMessage)

    def publish(poses: Tuple[Sighting, ...], t_capture_s: float) -> None:
        link.allow_list.admit()
        if poses:
            channel.send(PosesMessage(poses, t_capture_s))

    return publish


def _print_lines(poses: Tuple[Sighting, ...], t_capture_s: float) -> None:
    for pose in poses:
        print(json.dumps({**to_plain(pose), "t_capture_s": t_capture_s}), flush=True)


def locate_command(arguments: argparse.Namespace) -> None:
    """Find the robots in one picture, and tell or draw them."""
    from localizer_node.detect import annotated
    from localizer_node.node import locate_frame

    json_file = None if arguments.json in (None, STDOUT) else Path(arguments.json)
    expect_writable(json_file, arguments.picture, inputs=[arguments.image, arguments.calibration])
    image = read_picture(arguments.image)
    calibration = load_yaml(Calibration, arguments.calibration)
    found = locate_frame(image, calibration)
    if arguments.picture:
        write_png(arguments.picture, annotated(image, calibration, found))
    if json_file is not None:
        write_json(json_file, _located(found, arguments))
    elif arguments.json:
        print(json.dumps(_located(found, arguments), indent=1))
    if arguments.json:
        return
    for one in found:
        heading = "?" if one.heading_rad is None else f"{math.degrees(one.heading_rad):.1f}"
        print(f"{one.robot}: x {one.x_m:.3f} m, y {one.y_m:.3f} m, heading {heading} degrees")
    if not found:
        print("no robot found")


def _located(found: List["Detection"], arguments: argparse.Namespace) -> Dict[str, Any]:
    best = to_plain(found[0]) if found else {"confidence": 0.0}
    return {
        "schema": 1,
        "inputs": {name: str(getattr(arguments, name)) for name in ("image", "calibration")},
        "found": bool(found),
        **{key: best.get(key) for key in ("robot", "x_m", "y_m", "heading_rad", "confidence")},
        "robots": [to_plain(d) for d in found],
    }


if __name__ == "__main__":
    sys.exit(main())
