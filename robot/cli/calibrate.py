"""Measure this robot and write what was found into its configuration.

trim and baseline move the robot while a person watches; camera and lens look at a printed
chessboard, which target writes. What is implausible is refused, and nothing written.
"""

import argparse
import math
import re
from functools import reduce
from pathlib import Path
from typing import Any, List, Tuple

from robot.bringup import chessboard
from robot.bringup.roller import Prompts, Roller
from robot.bringup.wheels import GUIDES, Values
from robot.camera.files import read_picture, write_png
from robot.command_line import number
from robot.computer.clock import MonotonicClock
from robot.computer.systemd import on_ending
from robot.config import CameraConfig, RobotConfig
from robot.errors import ConfigError
from robot.hat.thread import real_motors
from robot.output import expect_writable, write_bytes, write_text
from robot.typed_config import from_plain, load_yaml, read_yaml, to_plain

NEAR_EDGE_M = 0.18
PICTURES = 20


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The command's options."""
    kinds = parser.add_subparsers(dest="what", required=True, metavar="WHAT")
    sheet = kinds.add_parser("target", help="the chessboard to print")
    sheet.add_argument("--out", type=Path, required=True, help="a .pdf file to write")
    trim = kinds.add_parser("trim", help="difference of the wheels, and radius: a straight drive")
    baseline = kinds.add_parser("baseline", help="distance of the wheels: turns on the spot")
    camera = kinds.add_parser("camera", help="pitch, roll and height of the camera: board on floor")
    camera.add_argument("--image", type=Path, help="a picture; without it one is taken now")
    told = "from the wheels' axle to the nearest row of squares (default %(default)s)"
    camera.add_argument("--ahead-m", type=number(0.02, 2.0), default=NEAR_EDGE_M, help=told)
    lens = kinds.add_parser("lens", help="the lens: pictures of the board at many angles")
    told = "folder of pictures; a new one: take them"
    lens.add_argument("--images", type=Path, required=True, help=told)
    for each in (trim, baseline, camera, lens):
        each.add_argument("--config", type=Path, required=True, help="the robot's YAML file")


def run(options: argparse.Namespace) -> None:
    """Do it; ConfigError for what is implausible, HardwareError when a device fails."""
    if options.what == "target":
        if options.out.suffix != ".pdf":
            raise ConfigError(f"--out: expected a name that ends in .pdf, got {options.out}")
        write_bytes(options.out, chessboard.SHEET.read_bytes())
        print(f"{options.out}: print it on A4 or Letter at 100 %, and check the 100 mm line")
        return
    on_ending()
    config = load_yaml(RobotConfig, options.config)
    expect_writable(options.config)  # before the work
    person = Prompts()
    if options.what == "camera":
        values = measure_camera(config, options.image, options.ahead_m, person)
    elif options.what == "lens":
        if not any(options.images.glob("*")):
            take_boards(config.camera, options.images, person)
        boards, size = chessboard.boards_from_files(options.images)
        lens, residual_px = chessboard.fit_lens(boards, size)
        person.tell(f"{len(boards)} pictures; residual {residual_px:.2f} px")
        values = {("camera", "lens", name): v for name, v in to_plain(lens, 6).items()}
    else:
        with real_motors(config.hat) as motors:
            values = GUIDES[options.what](Roller(motors, config.hat, MonotonicClock()), person)
    for edit in edit_yaml(options.config, values):
        person.tell(edit)


def take_boards(camera: CameraConfig, folder: Path, person: Prompts) -> None:
    """Pictures of the board by the robot's own camera; OSError: the folder cannot be made."""
    folder.mkdir(exist_ok=True)
    for k in range(1, PICTURES + 1):
        if not person.agrees(f"picture {k} of {PICTURES}: take it? n ends"):
            break
        write_png(folder / f"{k:02}.png", chessboard.take_picture(camera))


def measure_camera(config: RobotConfig, image: Path, near_edge_m: float, person: Prompts) -> Values:
    """Pitch, roll and height of the camera over the board on the floor."""
    picture = read_picture(image) if image else chessboard.take_picture(config.camera)
    corners = chessboard.find_board(picture)
    if corners is None:
        raise ConfigError(
            f"camera: expected the board with all its {chessboard.COLUMNS} by {chessboard.ROWS} "
            "squares, found none; lay it before the robot, in even light, with nothing on it"
        )
    size: Tuple[int, int] = (picture.shape[1], picture.shape[0])
    lens, before = config.camera.lens.of_picture(*size), config.camera.mount
    mount, residual_px = chessboard.fit_mount(corners, lens, near_edge_m, before)
    person.tell(
        f"pitch {math.degrees(mount.pitch_rad):.2f}°, roll {math.degrees(mount.roll_rad):.2f}°, "
        f"height {1e3 * mount.height_m:.1f} mm; residual {residual_px:.2f} px"
    )
    names = ("pitch_rad", "roll_rad", "height_m")
    return {("camera", "mount", name): round(getattr(mount, name), 5) for name in names}


def edit_yaml(path: Path, values: Values) -> List[str]:
    """Set values of a robot's file by their keys, such as ``("hat", "steps_per_rev")``.

    Each section that holds one is written anew, without its comments; the rest stays to the byte.
    The file is replaced whole or not at all, and only by one whose data differ in these values
    alone. Returns a line for each value that changed, from the default where the file said nothing.
    ConfigError: the file is no robot's before, or would not be afterwards.
    """
    import yaml

    before = from_plain(RobotConfig, read_yaml(path), where=str(path))
    wanted, text = to_plain(read_yaml(path)), path.read_text(encoding="utf-8")
    for keys, value in values.items():
        section = wanted
        for key in keys[:-1]:
            section[key] = dict(section.get(key) or {})  # not what an alias shares
            section = section[key]
        section[keys[-1]] = to_plain(value)
    after = from_plain(RobotConfig, wanted, where=str(path))
    for name in dict.fromkeys(keys[0] for keys in values):
        text = _with_section(text, name, wanted[name])
    try:
        found = yaml.safe_load(text)
    except yaml.YAMLError:
        found = None
    if found != wanted:
        lines = ", ".join(f"{'.'.join(keys)}: {value}" for keys, value in values.items())
        raise ConfigError(f"{path}: its layout is beyond me; write there yourself: {lines}")
    write_text(path, text)
    changes = [(".".join(keys), _at(before, keys), _at(after, keys)) for keys in values]
    return [f"{name}: {_shown(old)} -> {_shown(new)}" for name, old, new in changes if old != new]


def _with_section(text: str, name: str, content: Any) -> str:
    import yaml

    written = yaml.safe_dump({name: content}, default_flow_style=None, sort_keys=False, width=100)
    # Its line and the indented ones below, less empty ones behind them.
    section = re.compile(rf"^{name}:.*\n?(?:\n*[ \t].*\n?)*", re.MULTILINE)
    if section.search(text):
        return section.sub(lambda _: written, text, count=1)
    return text + ("\n" if text[-1:].strip() else "") + written


def _at(config: Any, keys: Tuple[str, ...]) -> Any:
    return reduce(lambda part, key: getattr(part, key, None), keys, config)


def _shown(value: Any) -> str:
    if isinstance(value, tuple):
        return f"[{', '.join(map(_shown, value))}]"
    return f"{value:.6g}" if isinstance(value, float) else "none" if value is None else str(value)
