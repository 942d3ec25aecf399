"""Undo what install did, last first. Edited configuration, keys and recorded drives stay."""

from __future__ import annotations

import argparse
import sys

from robot.cli.install import SHIPPED_MODEL, expect_root, say
from robot.computer.footprint import ROOT
from robot.install.changes import Host
from robot.install.plan import Source, make_plan, uninstall


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The command's options."""
    parser.add_argument("--dry-run", action="store_true", help="only print what would be undone")


def run(options: argparse.Namespace) -> None:
    """Do it; ConfigError for a wrong user, HardwareError when a command fails."""
    expect_root(options.dry_run)
    plan = make_plan(Source(ROOT, sys.executable, SHIPPED_MODEL))
    count = uninstall(plan, Host(), say, options.dry_run)
    print(f"{count} changes; nothing was done" if options.dry_run else f"{count} changes undone")
