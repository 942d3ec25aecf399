"""Motor HAT and camera."""

from __future__ import annotations

import math
from typing import Iterator, List, Tuple

from robot.camera.replay import open_reel
from robot.config import CameraConfig
from robot.contract import CONTROL_DT_S
from robot.doctor.findings import Finding, fail, ok, warn
from robot.doctor.machine import CameraLook, Machine
from robot.errors import ConfigError, HardwareError
from robot.hat.bus import USUAL_ADDRESSES, USUAL_BUSES
from robot.hat.clock import MonotonicClock
from robot.hat.config import HatConfig
from robot.hat.pca9685 import Pca9685
from robot.lens import Mount

WATCH_S = 2.0
DARK = 8.0  # mean of a picture through a covered lens, of 255
# What policies are trained to bear is randomised about the nominal mount by a little more.
PITCH_TOLERANCE_RAD = math.radians(3.0)
HEIGHT_TOLERANCE_M = 0.015


def check_hat(machine: Machine, config: HatConfig) -> Finding:
    """Whether the HAT answers where the configuration says, or where else it does."""
    name, problem = "motor HAT", ""
    buses = machine.buses()
    if not buses:
        return fail(
            name,
            "this computer has no I2C bus (/dev/i2c-*)",
            "on a Jetson pins 3 and 5 are one; elsewhere load the module i2c-dev",
        )
    found: List[Tuple[int, int]] = []
    for number in dict.fromkeys((config.bus, *(bus for bus in USUAL_BUSES if bus in buses))):
        try:
            found += _hats(machine, number, (*config.addresses, *USUAL_ADDRESSES))
        except HardwareError as error:
            problem = problem or str(error)
    for bus, address in found:
        if bus == config.bus and address in config.addresses:
            return ok(name, f"PCA9685 at 0x{address:02X} on /dev/i2c-{bus}")
    if found:
        bus, address = found[0]
        return fail(
            name,
            f"not on bus {config.bus} where hat.bus says, but at 0x{address:02X} on bus {bus}",
            f"set in the configuration: hat: {{bus: {bus}, addresses: [0x{address:02X}]}}",
        )
    if problem:
        says, _, remedy = problem.partition("; ")
        return fail(name, says, remedy or "see docs/wiring.md")
    shown = " and ".join(f"/dev/i2c-{bus}" for bus in dict.fromkeys((config.bus, *USUAL_BUSES)))
    return fail(
        name,
        f"nobody answers at {', '.join(f'0x{a:02X}' for a in config.addresses)} on {shown}",
        "check the HAT's seat, its 3.3 V, the address jumpers, and `i2cdetect -y -r "
        f"{config.bus}`; docs/wiring.md",
    )


def _hats(machine: Machine, bus: int, addresses: Tuple[int, ...]) -> Iterator[Tuple[int, int]]:
    opened = machine.open_bus(bus)
    for address in dict.fromkeys(addresses):
        if Pca9685.find(opened, address, MonotonicClock()) is not None:
            yield bus, address


def check_camera(machine: Machine, config: CameraConfig) -> Finding:
    """Whether pictures come, fast enough, and ever new ones."""
    name = "camera"
    if config.kind == "replay":
        return _check_replay(name, config)
    look = machine.watch(config, WATCH_S)
    if look.problem:
        says, _, remedy = look.problem.partition("; ")
        return fail(name, says, remedy or _camera_advice(config))
    needed_hz = 1.0 / CONTROL_DT_S
    seen = f"{look.size_px[0]}x{look.size_px[1]}, {look.rate_hz:.1f} pictures a second"
    if look.rate_hz < needed_hz:
        return fail(
            name,
            f"{seen}; the robot decides {needed_hz:g} times a second",
            "raise camera.fps; give a USB camera more light (a long exposure slows it)",
        )
    return _judge_pictures(name, seen, look, config)


def _check_replay(name: str, config: CameraConfig) -> Finding:
    try:
        open_reel(config.path)
    except ConfigError as error:
        return fail(name, str(error), "mend camera.path")
    return warn(name, f"a replay of {config.path}", "for driving choose the kind csi or v4l2")


def _judge_pictures(name: str, seen: str, look: CameraLook, config: CameraConfig) -> Finding:
    if look.repeats == look.pictures - 1:
        return fail(
            name,
            f"{seen}, but all of them the same bytes: it is frozen",
            "plug the camera again; CSI: sudo systemctl restart nvargus-daemon",
        )
    if look.brightness < DARK:
        return warn(name, f"{seen}, all but black", "take the cap off the lens, make light")
    if look.rate_hz < 0.8 * config.fps:
        return warn(
            name,
            f"{seen} instead of {config.fps}",
            "more light, or a lower camera.fps that the camera can keep",
        )
    return ok(name, seen)


def _camera_advice(config: CameraConfig) -> str:
    if config.kind == "csi":
        return "check the ribbon cable; sudo systemctl restart nvargus-daemon; ls /dev/video*"
    return "check the plug; ls /dev/video*"


def check_mount(mount: Mount) -> Finding:
    """Whether the camera looks as the policies expect."""
    nominal = Mount()
    if mount == nominal:
        return warn(
            "camera mount",
            "not measured: the nominal mount is assumed",
            "python -m robot calibrate camera",
        )
    tilt_rad = mount.pitch_rad - nominal.pitch_rad
    lift_m = mount.height_m - nominal.height_m
    seen = f"{math.degrees(mount.pitch_rad):.1f}° down, {1e3 * mount.height_m:.0f} mm high"
    if abs(tilt_rad) <= PITCH_TOLERANCE_RAD and abs(lift_m) <= HEIGHT_TOLERANCE_M:
        return ok("camera mount", seen)
    aim = f"{math.degrees(nominal.pitch_rad):.1f}° and {1e3 * nominal.height_m:.0f} mm"
    way = "up" if tilt_rad > 0.0 else "down"
    return warn(
        "camera mount",
        f"{seen}; the policies were trained for about {aim}",
        f"tilt it {way} by {abs(math.degrees(tilt_rad)):.1f}°, "
        f"{'lower' if lift_m > 0.0 else 'raise'} it by {abs(1e3 * lift_m):.0f} mm, "
        "then calibrate again",
    )
