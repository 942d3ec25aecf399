"""Make this computer the robot's: environment, user, groups, udev rule, configuration, service.

Run it in a checkout of the repository with the Python (3.8 or newer) that the robot shall use; run
it again after an update. A configuration that is there stays as it is. The service starts with the
computer, DISARMED; it is not started now.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from pathlib import Path
from typing import List, NamedTuple, Tuple, Union

from robot.computer.footprint import ROOT
from robot.errors import ConfigError, HardwareError
from robot.output import write_bytes

SHIPPED_MODEL = ROOT / "robot" / "models" / "lane_coached.onnx"
FILES = ROOT / "robot" / "install"  # which name the places below, too
PREFIX = "/opt/duckpilot"
VENV = f"{PREFIX}/venv"
MODEL = f"{PREFIX}/lane.onnx"
ETC = "/etc/duckpilot"
KEYS = f"{ETC}/keys"
CONFIG = f"{ETC}/robot.yaml"
STATE = "/var/lib/duckpilot"
UDEV_RULE = "/etc/udev/rules.d/99-duckpilot-i2c.rules"
UNIT = "duckpilot-robot.service"
UNIT_FILE = f"/etc/systemd/system/{UNIT}"
USER = "duckpilot"
GROUPS = ("i2c", "video", "gpio")
Command = Tuple[str, ...]


class Write(NamedTuple):
    """A file to write; what is ``theirs`` a person goes on to edit: only where there is none."""

    path: str
    content: bytes
    theirs: bool = False


Step = Union[Command, Write]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The command's options."""
    parser.add_argument("--dry-run", action="store_true", help="only print what would be done")
    parser.add_argument(
        "--model", type=Path, default=SHIPPED_MODEL, help="the policy to begin with"
    )


def run(options: argparse.Namespace) -> None:
    """Do it; ConfigError for a wrong source or user, HardwareError when a command fails."""
    steps = make_plan(ROOT, sys.executable, options.model)
    if options.dry_run:
        for step in steps:
            print("would", "\n".join(told(step)))
        print("nothing was done")
        return
    if os.geteuid() != 0:
        raise ConfigError("expected the user root, got another; use sudo, or --dry-run")
    for step in steps:
        print(told(step)[0], flush=True)
        do(step)
    print(f"Next: python -m robot doctor --config {CONFIG}")
    print(f"then: sudo systemctl start {UNIT}")


def make_plan(checkout: Path, python: str, model: Path) -> List[Step]:
    """All steps in order; each may be done again.

    ConfigError: the package does not lie in a checkout, or the model is absent.
    """
    if not (checkout / "pyproject.toml").is_file():
        raise ConfigError(
            f"{checkout}: expected a checkout of the repository, with pyproject.toml; run "
            "`python -m robot install` in one"
        )
    try:
        policy = model.read_bytes()
    except OSError as error:
        raise ConfigError(f"{model}: expected an ONNX policy, got: {error}") from error
    pip = (f"{VENV}/bin/python", "-I", "-m", "pip", "install", "--upgrade")
    pins = str(checkout / "constraints-nano.txt")
    user = f"useradd --system --user-group --home-dir {STATE} --shell /usr/sbin/nologin {USER}"
    return [
        *(_shell(f"getent group {name} || groupadd --system {name}") for name in GROUPS),
        _shell(f"id {USER} || {user}"),
        ("usermod", "--append", "--groups", ",".join(GROUPS), USER),
        ("install", "-d", PREFIX),
        ("install", "-d", "-o", USER, "-g", USER, ETC, STATE),  # calibration replaces files in it
        ("install", "-d", "-m", "700", "-o", USER, "-g", USER, KEYS),
        (python, "-m", "venv", VENV),
        (*pip, "pip"),  # Ubuntu 18.04's is too old to know the wheels of onnxruntime
        (*pip, "--constraint", pins, str(checkout)),
        Write(MODEL, policy),
        Write(CONFIG, (FILES / "robot.yaml").read_bytes(), theirs=True),
        Write(UDEV_RULE, (FILES / Path(UDEV_RULE).name).read_bytes()),
        ("udevadm", "control", "--reload"),
        ("udevadm", "trigger", "--subsystem-match=i2c-dev"),
        Write(UNIT_FILE, (FILES / UNIT).read_bytes()),
        ("systemctl", "daemon-reload"),
        ("systemctl", "enable", UNIT),
    ]


def _shell(line: str) -> Command:
    return ("sh", "-c", line)


def told(step: Step) -> List[str]:
    """What a step writes or runs, for a person."""
    if not isinstance(step, Write):
        return [f"run: {' '.join(step)}"]
    try:
        lines = step.content.decode("utf-8").splitlines()
    except UnicodeDecodeError:
        lines = [f"({len(step.content)} bytes)"]
    unless = ", unless it is there" if step.theirs else ""
    return [f"write {step.path}{unless}:", *(f"    {line}" for line in lines)]


def do(step: Step, root: Path = Path("/")) -> None:
    """Do one step, on the computer whose files lie below ``root``; HardwareError when it fails."""
    if isinstance(step, Write):
        path = root / step.path.lstrip("/")
        if not (step.theirs and path.exists()):
            write_bytes(path, step.content)
            path.chmod(0o644)
        return
    try:
        done = subprocess.run(step, check=False)
    except OSError as error:
        raise HardwareError(f"{step[0]}: expected a program, got: {error}") from error
    if done.returncode != 0:
        raise HardwareError(f"{' '.join(step)}: ended with status {done.returncode}")
