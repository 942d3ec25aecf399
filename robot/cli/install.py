"""Make this computer the robot's: environment, user, groups, udev rule, configuration, service.

Run it in a checkout with the Python (3.8 or newer) that the robot shall use, and again after an
update. A configuration stays as it is. The service starts with the computer, DISARMED; not now.
"""

import argparse
import os
import subprocess
import sys
from pathlib import Path
from typing import List

from robot.errors import ConfigError, HardwareError

ROOT = Path(__file__).resolve().parents[2]
SHIPPED_MODEL = ROOT / "robot" / "models" / "lane_sight.onnx"
SCRIPT = ROOT / "robot" / "install" / "install.sh"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The command's options."""
    parser.add_argument("--dry-run", action="store_true", help="only print what would be done")
    parser.add_argument("--model", type=Path, default=SHIPPED_MODEL, help="policy to begin with")


def run(options: argparse.Namespace) -> None:
    """Do it; ConfigError for a wrong source or user, HardwareError when a step fails."""
    command = make_command(ROOT, options.model)
    if options.dry_run:
        print(f"would run {' '.join(command)}\n\n{SCRIPT.read_text(encoding='utf-8')}")
        print("nothing was done")
        return
    if os.geteuid() != 0:
        raise ConfigError("expected the user root, got another; use sudo, or --dry-run")
    status = subprocess.run(command, check=False).returncode
    if status != 0:
        raise HardwareError(f"the last step above ended with status {status}; mend it, run again")
    print("Next: /opt/duckpilot/venv/bin/duckpilot doctor --config /etc/duckpilot/robot.yaml")
    print("then: sudo systemctl start duckpilot-robot.service")


def make_command(checkout: Path, model: Path) -> List[str]:
    """What installs a checkout; ConfigError where it is none, or there is no such model."""
    if not (checkout / "pyproject.toml").is_file():
        raise ConfigError(f"{checkout}: expected a checkout, with pyproject.toml; install from one")
    if not model.is_file():
        raise ConfigError(f"{model}: expected an ONNX policy, got no such file")
    return ["sh", str(SCRIPT), str(checkout), sys.executable, str(model)]
