"""Look at everything that the robot needs, and say what to do about what is wrong.

Nothing moves and nothing is written to any device. Exit status 1 when something FAILs.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Iterator, List, Optional

from robot.config import CameraConfig, RobotConfig
from robot.doctor import FAIL, OK, WARN, Finding
from robot.doctor.devices import check_camera, check_disk, check_hat, check_heat, check_mount
from robot.doctor.machine import Machine
from robot.doctor.software import check_link, check_map, check_policy, check_python
from robot.errors import ConfigError
from robot.hat.config import HatConfig
from robot.typed_config import load_yaml


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The command's options."""
    parser.add_argument("--config", type=Path, help="the robot's YAML file")


def run(options: argparse.Namespace) -> int:
    """Do it; 1 when something fails."""
    findings: List[Finding] = []
    for finding in examine(Machine(), options.config):
        findings.append(finding)
        print(finding.line, flush=True)
    counts = {level: sum(f.level == level for f in findings) for level in (OK, WARN, FAIL)}
    print(", ".join(f"{count} {level}" for level, count in counts.items()))
    return int(counts[FAIL] > 0)


def examine(machine: Machine, config_path: Optional[Path]) -> Iterator[Finding]:
    """Each finding as soon as it is known."""
    yield from check_python(machine)
    config: Optional[RobotConfig] = None
    if config_path is None:
        yield Finding("config", WARN, "none given: defaults are looked at", "--config FILE")
    else:
        try:
            config = load_yaml(RobotConfig, config_path)
            yield Finding("config", OK, f"{config_path}: robot {config.name!r}")
        except ConfigError as error:
            remedy = "mend the file; docs/runtime.md describes it"
            yield Finding("config", FAIL, str(error), remedy)
    camera = config.camera if config else CameraConfig()
    yield check_hat(machine, config.hat if config else HatConfig())
    yield check_camera(machine, camera)
    yield check_mount(camera.mount)
    if config is not None:
        yield check_policy(config)
        yield check_map(config)
        yield from check_link(machine, config)
    yield check_disk(machine, config.recording if config else None)
    yield check_heat(machine)
