"""Look at everything that the robot needs, and say what to do about what is wrong.

Nothing moves and nothing is written to any device. Exit status 1 when something FAILs.
"""

import argparse
import math
from pathlib import Path
from typing import Iterator, List, NamedTuple, Optional, Tuple

from robot.computer.clock import MonotonicClock
from robot.computer.health import LEAST_DISK_MB
from robot.computer.machine import Machine
from robot.config import CameraConfig, RobotConfig
from robot.contract import CONTROL_DT_S
from robot.errors import ConfigError, DuckpilotError, HardwareError
from robot.hat.bus import USUAL_ADDRESSES, USUAL_BUSES, Pca9685
from robot.hat.config import HatConfig
from robot.inference.policy import open_policy, time_decisions
from robot.lens import Mount
from robot.link.keys import load_keys
from robot.link.messages import Reading
from robot.link.sockets import LinkConfig
from robot.navigation.road_map import load_map
from robot.typed_config import load_yaml
from robot.vision.sight import OnnxSight

OK = "OK"
WARN = "WARN"  # the robot drives, but a person should know
FAIL = "FAIL"  # the robot cannot drive so

PACKAGES = ("numpy", "opencv-python-headless", "onnxruntime", "PyYAML", "smbus2", "pyzmq", "mcap")
DECISIONS = 30
SHARE = 0.5  # of the time between two decisions that one may take
WATCH_S = 2.0
DARK = 8.0  # mean of a picture through a covered lens, of 255
# What policies are trained to bear is randomised about the nominal mount by a little more.
PITCH_TOLERANCE_RAD = math.radians(3.0)
HEIGHT_TOLERANCE_M = 0.015
REMEDIES = {
    "temperature": "give the heat sink air or a fan",
    "disk free": "delete old recordings, or none can be made",
    "memory free": "end other programs",
}
NO_PICTURES = "plug the camera again; CSI: restart nvargus-daemon"

Ill = Tuple[bool, str, str, str]  # whether it is so, its level, what it is, what to do


class Finding(NamedTuple):
    """One line of the report: what was looked at, how bad it is, what it is, and what to do."""

    name: str
    level: str
    says: str
    remedy: str = ""

    @property
    def line(self) -> str:
        """For a person."""
        text = f"{self.level:4s}  {self.name:14s}{self.says}"
        return f"{text}\n{'':20s}-> {self.remedy}" if self.remedy else text


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
    yield from _python(machine)
    config: Optional[RobotConfig] = None
    if config_path is None:
        yield Finding("config", WARN, "none given: defaults are looked at", "--config FILE")
    else:
        try:
            config = load_yaml(RobotConfig, config_path)
            yield Finding("config", OK, f"{config_path}: robot {config.name!r}")
        except ConfigError as error:
            yield Finding("config", FAIL, str(error), "mend the file; docs/runtime.md describes it")
    camera = config.camera if config else CameraConfig()
    yield _hat(machine, config.hat if config else HatConfig())
    yield _camera(machine, camera)
    yield _mount(camera.mount)
    if config is not None:
        yield check_policy(config)
        yield _map(config.map)
        yield from _link(machine, config)
    recording = config.recording if config else None
    least_mb = max(LEAST_DISK_MB, recording.keep_free_mb if recording else 0.0)
    place = Path(recording.folder if recording else ".")
    yield from map(_health, machine.readings(place, least_mb))


def _judged(name: str, seen: str, *ills: Ill) -> Finding:
    """The first of the ills that is so, told behind what was seen; else all is well."""
    for is_so, level, more, remedy in ills:
        if is_so:
            return Finding(name, level, seen + more, remedy)
    return Finding(name, OK, seen)


def _refused(name: str, error: Exception, remedy: str) -> Finding:
    """A failure as an error tells it: what it is, and behind the semicolon what to do."""
    says, _, told = str(error).partition("; ")
    return Finding(name, FAIL, says, told or remedy)


def _python(machine: Machine) -> Iterator[Finding]:
    yield Finding("Python", OK, f"{'.'.join(map(str, machine.python))} on {machine.processor}")
    found = {name: machine.package(name) for name in PACKAGES}
    absent = " ".join(name for name, got in found.items() if got is None)
    deadly = machine.processor == "aarch64" and str(found["onnxruntime"]).startswith("1.21.")
    dies = "; this onnxruntime dies with SIGILL on the Nano's processor"
    yield _judged(
        "packages",
        ", ".join(f"{name} {got}" for name, got in found.items() if got),
        (bool(absent), FAIL, f"; not {absent}", f"python -m pip install {absent}"),
        (deadly, FAIL, dies, "python -m pip install onnxruntime==1.19.2"),
    )


def _hat(machine: Machine, config: HatConfig) -> Finding:
    """Whether the HAT answers where the configuration says, or where else it does."""
    name, buses = "motor HAT", machine.buses()
    if not buses:
        remedy = "on a Jetson pins 3 and 5 are one; elsewhere load the module i2c-dev"
        return Finding(name, FAIL, "this computer has no I2C bus (/dev/i2c-*)", remedy)
    found: List[Tuple[int, int]] = []
    problem: Optional[HardwareError] = None
    for number in dict.fromkeys((config.bus, *(bus for bus in USUAL_BUSES if bus in buses))):
        try:
            opened = machine.open_bus(number)
            for address in dict.fromkeys((*config.addresses, *USUAL_ADDRESSES)):
                if Pca9685.find(opened, address, MonotonicClock()) is not None:
                    found.append((number, address))
        except HardwareError as error:
            problem = problem or error
    for bus, address in found:
        if bus == config.bus and address in config.addresses:
            return Finding(name, OK, f"PCA9685 at 0x{address:02X} on /dev/i2c-{bus}")
    if found:
        bus, address = found[0]
        says = f"not on bus {config.bus} where hat.bus says, but at 0x{address:02X} on bus {bus}"
        remedy = f"set in the configuration: hat: {{bus: {bus}, addresses: [0x{address:02X}]}}"
        return Finding(name, FAIL, says, remedy)
    if problem is not None:
        return _refused(name, problem, "see docs/wiring.md")
    says = f"nobody answers at {', '.join(f'0x{a:02X}' for a in config.addresses)}"
    remedy = "check the HAT's seat, its 3.3 V, the address jumpers, and `i2cdetect -y -r"
    return Finding(name, FAIL, says, f"{remedy} {config.bus}`; docs/wiring.md")


def _camera(machine: Machine, config: CameraConfig) -> Finding:
    """Whether pictures come, fast enough, and ever new ones."""
    try:
        look = machine.watch(config, WATCH_S)
    except (HardwareError, DuckpilotError) as error:
        return _refused("camera", error, "check plug and ribbon; CSI: restart nvargus-daemon")
    needed_hz = 1.0 / CONTROL_DT_S
    slow = look.rate_hz < needed_hz
    decides = f"; the robot decides {needed_hz:g} times a second"
    slower = look.rate_hz < 0.8 * config.fps
    return _judged(
        "camera",
        f"{look.size_px[0]}x{look.size_px[1]}, {look.rate_hz:.1f} pictures a second",
        (slow, FAIL, decides, "raise camera.fps; give a USB camera more light"),
        (look.frozen, FAIL, ", but all of them the same bytes: it is frozen", NO_PICTURES),
        (look.brightness < DARK, WARN, ", all but black", "take the cap off, make light"),
        (slower, WARN, f" instead of {config.fps}", "more light, or a lower camera.fps"),
    )


def _mount(mount: Mount) -> Finding:
    """Whether the camera looks as the policies expect."""
    name, nominal = "camera mount", Mount()
    if mount == nominal:
        says = "not measured: the nominal mount is assumed"
        return Finding(name, WARN, says, "duckpilot calibrate camera")
    tilt_rad = mount.pitch_rad - nominal.pitch_rad
    lift_m = mount.height_m - nominal.height_m
    off = abs(tilt_rad) > PITCH_TOLERANCE_RAD or abs(lift_m) > HEIGHT_TOLERANCE_M
    trained = f"{math.degrees(nominal.pitch_rad):.1f}° and {1e3 * nominal.height_m:.0f} mm"
    tilt = f"tilt it {'up' if tilt_rad > 0.0 else 'down'} by {abs(math.degrees(tilt_rad)):.1f}°"
    lift = f"{'lower' if lift_m > 0.0 else 'raise'} it by {abs(1e3 * lift_m):.0f} mm"
    return _judged(
        name,
        f"{math.degrees(mount.pitch_rad):.1f}° down, {1e3 * mount.height_m:.0f} mm high",
        (off, WARN, f"; trained for about {trained}", f"{tilt}, {lift}, then calibrate again"),
    )


def check_policy(config: RobotConfig) -> Finding:
    """Whether policy, translator and sight load, and decide fast enough on this computer."""
    try:
        if config.sight:
            OnnxSight(config.sight)
        policy = open_policy(config.model, config.translator)
        timing = time_decisions(policy, DECISIONS)
    except DuckpilotError as error:
        return _refused("policy", error, "set `model` to a policy of duckpilot export")
    contract = policy.contract
    lost = contract.path_points > 0 and not config.map
    rules, keeps = config.rules, contract.path_points == 0
    blind = rules.headway and keeps and not config.sight
    slow = f", of {1e3 * CONTROL_DT_S:.0f} ms between two decisions"
    is_slow = timing.p50_ms > 1e3 * CONTROL_DT_S * SHARE
    proof = f"; {contract.proof.sentence}" if contract.proof else ""
    return _judged(
        "policy",
        f"{contract.task}, {contract.algorithm}, decides in {timing.p50_ms:.1f} ms{proof}",
        (bool(contract.unproven), FAIL, f"; {contract.unproven}", "the robot does not arm with it"),
        (lost, FAIL, "; it navigates, but no map is set", "set `map` and a `link`"),
        (rules.stop_lines and keeps, FAIL, "; it knows no stop lines", "leave stop_lines out"),
        (blind, FAIL, "; nothing tells it what is ahead", "set `sight`, or no rules.headway"),
        (is_slow, FAIL, slow, "use the INT8 file or a smaller policy"),
    )


def _map(name: str) -> Finding:
    if not name:
        return Finding("map", OK, "none: the robot keeps its lane")
    try:
        road_map = load_map(name)
    except DuckpilotError as error:
        return Finding("map", FAIL, str(error), "mend `map`: a file, or the name of a shipped map")
    return Finding("map", OK, f"{name}, {road_map.width_m:.2f} x {road_map.height_m:.2f} m")


def _link(machine: Machine, config: RobotConfig) -> Iterator[Finding]:
    """Keys, and whether the localizer answers."""
    link = config.link
    if link is None:
        yield Finding("link", OK, "none: the robot is driven from its own terminal")
        return
    yield _keys(link)
    if config.map:
        place = f"at {link.localizer_host}:{link.base_port}"
        problem = machine.connects(link.localizer_host, link.base_port)
        says = f"does not answer {place}: {problem}" if problem else f"answers {place}"
        says += "; sight tells the place" if problem and config.sight else ""
        remedy = f"is it running? ping {link.localizer_host}; mend link.localizer_host"
        yield _judged("localizer", says, (bool(problem and not config.sight), WARN, "", remedy))


def _keys(link: LinkConfig) -> Finding:
    try:
        keys = load_keys(link.keys)
    except (ConfigError, OSError) as error:
        return _refused("keys", error, "docs/links.md tells how keys are made and copied")
    return _judged(
        "keys",
        f"{link.keys}, mode 600; allowed: {', '.join(sorted(keys.peers)) or 'nobody'}",
        (keys.role != "robot", FAIL, "; another machine's folder", "copy the folder robot/"),
        (not keys.peers, FAIL, "", "copy the peers' keys to its folder allowed/"),
    )


def _health(reading: Reading) -> Finding:
    """As the robot judges itself while it drives."""
    level = {"ok": OK, "warn": WARN, "bad": FAIL}[reading.level]
    says = f"{reading.value:g} {reading.unit}".strip()
    return Finding(reading.name, level, says, "" if level == OK else REMEDIES[reading.name])
