"""Interpreter, packages, policy, map, keys and links."""

from __future__ import annotations

from typing import Iterator

from robot.config import RobotConfig
from robot.contract import CONTROL_DT_S
from robot.doctor import FAIL, OK, WARN, Finding, refused
from robot.doctor.machine import Machine
from robot.errors import ConfigError, DuckpilotError
from robot.inference.policy import time_decisions
from robot.link.config import LinkConfig
from robot.link.keys import load_keys
from robot.navigation.road_map import load_map
from robot.runtime.assemble import open_policy

OLDEST_PYTHON = (3, 8)
PACKAGES = ("numpy", "opencv-python-headless", "onnxruntime", "PyYAML", "smbus2", "pyzmq", "mcap")
DECISIONS = 30
SHARE = 0.5  # of the time between two decisions that one may take


def check_python(machine: Machine) -> Iterator[Finding]:
    """Versions of interpreter and packages."""
    version = f"{'.'.join(map(str, machine.python))} on {machine.processor}"
    if machine.python < OLDEST_PYTHON:
        yield Finding("Python", FAIL, version, "install 3.8 or newer; Ubuntu 18.04: apt python3.8")
    else:
        yield Finding("Python", OK, version)
    found = {name: machine.package(name) for name in PACKAGES}
    absent = " ".join(name for name, got in found.items() if got is None)
    if absent:
        says, remedy = f"{absent}: not installed", f"python -m pip install {absent}"
        yield Finding("packages", FAIL, says, remedy)
        return
    if machine.processor == "aarch64" and str(found["onnxruntime"]).startswith("1.21."):
        says = f"onnxruntime {found['onnxruntime']} dies with SIGILL on the Nano's processor"
        yield Finding("packages", FAIL, says, "python -m pip install onnxruntime==1.19.2")
        return
    yield Finding("packages", OK, ", ".join(f"{name} {got}" for name, got in found.items()))


def check_policy(config: RobotConfig) -> Finding:
    """Whether the policy (with its translator) loads and decides fast enough on this computer."""
    name = "policy"
    try:
        policy = open_policy(config)
        timing = time_decisions(policy, DECISIONS)
    except DuckpilotError as error:
        return refused(name, error, "set `model` to a policy of python -m trainer export")
    contract = policy.contract
    seen = f"{contract.task}, {contract.algorithm}, decides in {timing.p50_ms:.1f} ms"
    if contract.unproven:
        return Finding(name, FAIL, f"{seen}; {contract.unproven}", "the robot does not arm with it")
    if contract.path_points and not config.map:
        says = f"{seen}; it navigates, but no map is set"
        return Finding(name, FAIL, says, "set `map` and a `link`")
    if timing.p50_ms > 1e3 * CONTROL_DT_S * SHARE:
        says = f"{seen}, of {1e3 * CONTROL_DT_S:.0f} ms between two decisions"
        return Finding(name, FAIL, says, "use the INT8 file or a smaller policy")
    return Finding(name, OK, seen)


def check_map(config: RobotConfig) -> Finding:
    """Whether the map can be driven on."""
    if not config.map:
        return Finding("map", OK, "none: the robot keeps its lane")
    try:
        road_map = load_map(config.map)
    except DuckpilotError as error:
        return Finding("map", FAIL, str(error), "mend `map`: a file, or the name of a shipped map")
    says = f"{config.map}, {road_map.width_m:.2f} x {road_map.height_m:.2f} m"
    return Finding("map", OK, says)


def check_link(machine: Machine, config: RobotConfig) -> Iterator[Finding]:
    """Keys, and whether the localizer answers."""
    link = config.link
    if link is None:
        yield Finding("link", OK, "none: the robot is driven from its own terminal")
        return
    yield _check_keys(link)
    if config.map:
        place = f"{link.localizer_host}:{link.base_port}"
        problem = machine.connects(link.localizer_host, link.base_port)
        if problem:
            remedy = f"is it running? ping {link.localizer_host}; mend link.localizer_host"
            says = f"does not answer at {place}: {problem}"
            yield Finding("localizer", WARN, says, remedy)
        else:
            yield Finding("localizer", OK, f"answers at {place}")


def _check_keys(link: LinkConfig) -> Finding:
    name, remedy = "keys", "python -m robot keygen keys"
    if not link.keys:
        if not link.plaintext:
            return Finding(name, FAIL, "neither keys nor plaintext are set", remedy)
        return Finding(name, WARN, "none: plaintext, on this computer only", remedy)
    try:
        keys = load_keys(link.keys)
    except (ConfigError, OSError) as error:
        return refused(name, error, "docs/links.md tells how keys are made and copied")
    if keys.role != "robot":
        says = f"{link.keys} is another machine's folder"
        return Finding(name, FAIL, says, "copy the folder robot/")
    if not keys.peers:
        says = f"{link.keys}/allowed: nobody is allowed"
        return Finding(name, FAIL, says, "copy the peers' keys there")
    return Finding(name, OK, f"{link.keys}, mode 600; allowed: {', '.join(sorted(keys.peers))}")
