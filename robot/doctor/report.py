"""All checks, in the order in which a person would mend what they find."""

from __future__ import annotations

from pathlib import Path
from typing import Iterator, Optional

from robot.config import CameraConfig, RobotConfig
from robot.doctor.devices import check_camera, check_hat, check_mount
from robot.doctor.findings import Finding, fail, ok, warn
from robot.doctor.health import check_clock, check_disk, check_heat, check_throttling
from robot.doctor.machine import Machine
from robot.doctor.software import check_link, check_map, check_policy, check_python
from robot.errors import ConfigError
from robot.hat.config import HatConfig
from robot.typed_config import load_yaml


def examine(machine: Machine, config_path: Optional[Path]) -> Iterator[Finding]:
    """Each finding as soon as it is known.

    Args:
        machine: this computer.
        config_path: the robot's YAML file; without one the devices are looked for by default.
    """
    yield from check_python(machine)
    config: Optional[RobotConfig] = None
    if config_path is None:
        yield warn("config", "none given: defaults are looked at", "--config /etc/.../robot.yaml")
    else:
        try:
            config = load_yaml(RobotConfig, config_path)
            yield ok("config", f"{config_path}: robot {config.name!r}")
        except ConfigError as error:
            yield fail("config", str(error), "mend the file; docs/runtime.md describes it")
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
    yield check_throttling(machine)
    yield check_clock(machine)
