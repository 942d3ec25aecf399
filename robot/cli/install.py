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

    Args:
        checkout: of this repository.
        python: the interpreter that the robot's environment is made of.
        model: the policy to begin with.

    Raises:
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
        Write(CONFIG, config_text(MODEL).encode("utf-8"), theirs=True),
        Write(UDEV_RULE, UDEV.encode("utf-8")),
        ("udevadm", "control", "--reload"),
        ("udevadm", "trigger", "--subsystem-match=i2c-dev"),
        Write(UNIT_FILE, unit_text(" ".join(GROUPS)).encode("utf-8")),
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


UDEV = """\
# duckpilot: the group i2c may use the buses, as the robot's motor HAT needs it.
SUBSYSTEM=="i2c-dev", GROUP="i2c", MODE="0660"
"""


def unit_text(groups: str) -> str:
    """The systemd unit; ``groups`` separated by spaces.

    The robot boots DISARMED, so a restart never drives. WatchdogSec kills a loop that hangs; what
    runs after every end, however it came, switches the motors off.
    """
    python = f"{VENV}/bin/python"
    return f"""\
# {UNIT}: written by `python -m robot install`.
[Unit]
Description=duckpilot robot (boots DISARMED; a person arms it)
After=network-online.target nvargus-daemon.service
Wants=network-online.target
StartLimitIntervalSec=60
StartLimitBurst=5

[Service]
Type=notify
User={USER}
SupplementaryGroups={groups}
WorkingDirectory={STATE}
Environment=PYTHONUNBUFFERED=1
ExecStart={python} -m robot drive --config {CONFIG}
ExecStopPost={python} -m robot off --config {CONFIG}
TimeoutStopSec=5
WatchdogSec=2
Restart=on-failure
RestartSec=3
# 2 is wrong input: a person has to mend it first.
RestartPreventExitStatus=2
Nice=-5
LimitCORE=0
MemoryMax=512M
NoNewPrivileges=yes
ProtectSystem=strict
ProtectHome=yes
ReadWritePaths={STATE}

[Install]
WantedBy=multi-user.target
"""


def config_text(model: str) -> str:
    """The first configuration: what a person must look at; everything else has a default."""
    return f"""\
# The robot. docs/runtime.md describes every section; `python -m robot doctor --config {CONFIG}`
# says what is wrong with it.
model: {model}
name: robot
camera: {{kind: csi}}
hat: {{steps_per_rev: 48, left: {{port: M1M2}}, right: {{port: M3M4, reversed: true}}}}
safety: {{max_wheel_mps: 0.2}}
recording: {{folder: {STATE}/drives}}
# For a monitor and a localizer, after `python -m robot keygen`:
# map: town
# link: {{keys: /etc/duckpilot/keys/robot, localizer_host: 192.168.1.11}}
"""
