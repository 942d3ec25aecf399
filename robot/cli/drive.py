"""Drive. The robot starts DISARMED; a person arms it here or at the monitor."""

from __future__ import annotations

import argparse
import logging
import sys
from pathlib import Path
from typing import List

from robot.cli.ending import on_ending
from robot.cli.terminal import PROMPT, Terminal
from robot.config import RobotConfig
from robot.runtime.assemble import open_robot
from robot.systemd import Heartbeat, notify_socket
from robot.typed_config import load_yaml


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The command's options."""
    parser.add_argument("--config", type=Path, required=True, help="the robot's YAML file")


def run(options: argparse.Namespace) -> None:
    """Do it, until quit, an interrupt, SIGTERM or SIGHUP."""
    logging.basicConfig(format="%(asctime)s %(levelname)s %(name)s: %(message)s")
    config = load_yaml(RobotConfig, options.config)
    ended: List[bool] = []
    on_ending(lambda: ended.append(True))
    terminal = Terminal(sys.stdin, _say)
    notify = notify_socket() or _nobody
    with open_robot(config, (terminal,), (terminal, Heartbeat(notify))) as runtime:
        _say(PROMPT)
        notify("READY=1")
        runtime.run(ending=lambda: terminal.quitting or bool(ended))
        notify("STOPPING=1")


def _nobody(_line: str) -> None:
    """Systemd did not start this program."""


def _say(line: str) -> None:
    print(line, flush=True)
