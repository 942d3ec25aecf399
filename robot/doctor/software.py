"""Interpreter, packages, policy, map, keys and links."""

from __future__ import annotations

from typing import Iterator, List, Tuple

from robot.config import RobotConfig
from robot.contract import CONTROL_DT_S
from robot.doctor.findings import Finding, fail, ok, warn
from robot.doctor.machine import Machine
from robot.errors import ConfigError, DuckpilotError
from robot.inference.policy import time_decisions
from robot.link.config import LinkConfig
from robot.link.keys import load_keys
from robot.link.roles import BOUND_BY
from robot.navigation.road_map import load_map
from robot.runtime.assemble import open_policy

OLDEST_PYTHON = (3, 8)
PACKAGES = ("numpy", "opencv-python-headless", "onnxruntime", "PyYAML", "smbus2", "pyzmq", "mcap")
DECISIONS = 30
SHARE = 0.5  # of the time between two decisions that one may take


def check_python(machine: Machine) -> Iterator[Finding]:
    """Versions of interpreter and packages."""
    version = ".".join(map(str, machine.python()))
    if machine.python() < OLDEST_PYTHON:
        yield fail("Python", version, "install Python 3.8 or newer; Ubuntu 18.04: apt python3.8")
    else:
        yield ok("Python", f"{version} on {machine.processor()}")
    found = [(name, machine.package(name)) for name in PACKAGES]
    absent = [name for name, got in found if got is None]
    if absent:
        names = " ".join(absent)
        yield fail("packages", f"{names}: not installed", f"python -m pip install {names}")
        return
    onnxruntime = str(dict(found)["onnxruntime"])
    if machine.processor() == "aarch64" and onnxruntime.startswith("1.21."):
        yield fail(
            "packages",
            f"onnxruntime {onnxruntime} dies with SIGILL on the Nano's processor",
            "python -m pip install onnxruntime==1.19.2",
        )
        return
    yield ok("packages", ", ".join(f"{name} {got}" for name, got in found))


def check_policy(config: RobotConfig) -> Finding:
    """Whether the policy (with its translator) loads and decides fast enough on this computer."""
    name = "policy"
    try:
        policy = open_policy(config)
        timing = time_decisions(policy, DECISIONS)
    except DuckpilotError as error:
        says, _, remedy = str(error).partition("; ")
        return fail(name, says, remedy or "set `model` to a policy of python -m trainer export")
    contract = policy.contract
    seen = f"{contract.task}, {contract.algorithm}, decides in {timing.p50_ms:.1f} ms"
    if contract.path_points and not config.map:
        return fail(name, f"{seen}; it navigates, but no map is set", "set `map` and a `link`")
    if timing.p50_ms > 1e3 * CONTROL_DT_S * SHARE:
        return fail(
            name,
            f"{seen}, of {1e3 * CONTROL_DT_S:.0f} ms between two decisions",
            "use the INT8 file or a smaller policy; look at throttling below",
        )
    return ok(name, seen)


def check_map(config: RobotConfig) -> Finding:
    """Whether the map can be driven on."""
    if not config.map:
        return ok("map", "none: the robot keeps its lane")
    try:
        road_map = load_map(config.map)
    except DuckpilotError as error:
        return fail("map", str(error), "mend `map`: a file, or the name of a shipped map")
    return ok("map", f"{config.map}, {road_map.width_m:.2f} x {road_map.height_m:.2f} m")


def check_link(machine: Machine, config: RobotConfig) -> Iterator[Finding]:
    """Keys, own ports, and whether the localizer answers."""
    link = config.link
    if link is None:
        yield ok("link", "none: the robot is driven from its own terminal")
        return
    yield _check_keys(link)
    taken = [stream for stream, port in _own_ports(link) if not machine.port_is_free(port)]
    if taken:
        yield warn(
            "ports",
            f"another program listens where {', '.join(taken)} would",
            "is the robot running already? systemctl status duckpilot-robot",
        )
    if config.map:
        yield _check_localizer(machine, link)


def _own_ports(link: LinkConfig) -> List[Tuple[str, int]]:
    streams = list(BOUND_BY)
    return [(s, link.base_port + streams.index(s)) for s in streams if BOUND_BY[s] == "robot"]


def _check_keys(link: LinkConfig) -> Finding:
    if not link.keys:
        if not link.plaintext:
            return fail("keys", "neither keys nor plaintext are set", "python -m robot keygen keys")
        return warn("keys", "none: plaintext, on this computer only", "python -m robot keygen keys")
    try:
        keys = load_keys(link.keys)
    except (ConfigError, OSError) as error:
        says, _, remedy = str(error).partition("; ")
        return fail("keys", says, remedy or "docs/links.md tells how keys are made and copied")
    if keys.role != "robot":
        return fail("keys", f"{link.keys} is another machine's folder", "copy the folder robot/")
    if not keys.peers:
        return fail("keys", f"{link.keys}/allowed: nobody is allowed", "copy the peers' keys there")
    return ok("keys", f"{link.keys}, mode 600; allowed: {', '.join(sorted(keys.peers))}")


def _check_localizer(machine: Machine, link: LinkConfig) -> Finding:
    place = f"{link.localizer_host}:{link.base_port}"
    problem = machine.connects(link.localizer_host, link.base_port)
    if problem:
        return warn(
            "localizer",
            f"does not answer at {place}: {problem}",
            f"is it running? ping {link.localizer_host}; mend link.localizer_host",
        )
    return ok("localizer", f"answers at {place}")
