"""Make this computer the robot's: environment, user, groups, udev rule, configuration, service.

Run it in a checkout of the repository with the Python (3.8 or newer) that the robot shall use. A
second time it changes only what is not so yet. The service starts with the computer, DISARMED; it
is not started now.
"""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path

from robot.computer.footprint import ROOT
from robot.errors import ConfigError
from robot.install.changes import Host
from robot.install.files import CONFIG, UNIT
from robot.install.plan import Source, install, make_plan

SHIPPED_MODEL = ROOT / "robot" / "models" / "lane_coached.onnx"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The command's options."""
    parser.add_argument("--dry-run", action="store_true", help="only print what would be done")
    parser.add_argument(
        "--model", type=Path, default=SHIPPED_MODEL, help="the policy to begin with"
    )


def run(options: argparse.Namespace) -> None:
    """Do it; ConfigError for a wrong source or user, HardwareError when a command fails."""
    plan = make_plan(Source(ROOT, sys.executable, options.model))
    expect_root(options.dry_run)
    count = install(plan, Host(), say, options.dry_run)
    if options.dry_run:
        print(f"{count} changes; nothing was done")
    elif count:
        print(f"{count} changes. Next: python -m robot doctor --config {CONFIG}")
        print(f"then: sudo systemctl start {UNIT}")
    else:
        print("everything is installed already")


def expect_root(dry: bool) -> None:
    """ConfigError unless this user may change the system, or does not try."""
    if not dry and os.geteuid() != 0:
        raise ConfigError("expected the user root, got another; use sudo, or --dry-run")


def say(line: str) -> None:
    """One line, at once."""
    print(line, flush=True)
