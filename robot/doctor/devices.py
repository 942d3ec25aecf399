"""Motor HAT, camera, disk and heat."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Iterator, List, Optional, Tuple

from robot.computer.clock import MonotonicClock
from robot.config import CameraConfig, RecordingConfig
from robot.contract import CONTROL_DT_S
from robot.doctor import FAIL, OK, WARN, Finding, refused
from robot.doctor.machine import CameraLook, Machine
from robot.errors import HardwareError
from robot.hat.bus import USUAL_ADDRESSES, USUAL_BUSES
from robot.hat.config import HatConfig
from robot.hat.pca9685 import Pca9685
from robot.lens import Mount

WATCH_S = 2.0
DARK = 8.0  # mean of a picture through a covered lens, of 255
# What policies are trained to bear is randomised about the nominal mount by a little more.
PITCH_TOLERANCE_RAD = math.radians(3.0)
HEIGHT_TOLERANCE_M = 0.015
MB = 1e6
LEAST_MB, ROOM_MB = 200.0, 500.0  # that a system needs; for some hours of recording
WARM_C, HOT_C = 75.0, 90.0  # a Nano throttles from 97 on, and switches off at 103


def check_hat(machine: Machine, config: HatConfig) -> Finding:
    """Whether the HAT answers where the configuration says, or where else it does."""
    name = "motor HAT"
    buses = machine.buses()
    if not buses:
        return Finding(
            name,
            FAIL,
            "this computer has no I2C bus (/dev/i2c-*)",
            "on a Jetson pins 3 and 5 are one; elsewhere load the module i2c-dev",
        )
    found: List[Tuple[int, int]] = []
    problem: Optional[HardwareError] = None
    for number in dict.fromkeys((config.bus, *(bus for bus in USUAL_BUSES if bus in buses))):
        try:
            found += _hats(machine, number, (*config.addresses, *USUAL_ADDRESSES))
        except HardwareError as error:
            problem = problem or error
    for bus, address in found:
        if bus == config.bus and address in config.addresses:
            return Finding(name, OK, f"PCA9685 at 0x{address:02X} on /dev/i2c-{bus}")
    if found:
        bus, address = found[0]
        return Finding(
            name,
            FAIL,
            f"not on bus {config.bus} where hat.bus says, but at 0x{address:02X} on bus {bus}",
            f"set in the configuration: hat: {{bus: {bus}, addresses: [0x{address:02X}]}}",
        )
    if problem is not None:
        return refused(name, problem, "see docs/wiring.md")
    return Finding(
        name,
        FAIL,
        f"nobody answers at {', '.join(f'0x{a:02X}' for a in config.addresses)}",
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
    try:
        look = machine.watch(config, WATCH_S)
    except HardwareError as error:
        return refused(name, error, "check plug and ribbon; CSI: restart nvargus-daemon")
    return _judge_pictures(name, look, config)


def _judge_pictures(name: str, look: CameraLook, config: CameraConfig) -> Finding:
    needed_hz = 1.0 / CONTROL_DT_S
    seen = f"{look.size_px[0]}x{look.size_px[1]}, {look.rate_hz:.1f} pictures a second"
    if look.rate_hz < needed_hz:
        says = f"{seen}; the robot decides {needed_hz:g} times a second"
        return Finding(name, FAIL, says, "raise camera.fps; give a USB camera more light")
    if look.repeats == look.pictures - 1:
        says = f"{seen}, but all of them the same bytes: it is frozen"
        return Finding(name, FAIL, says, "plug the camera again; CSI: restart nvargus-daemon")
    if look.brightness < DARK:
        return Finding(name, WARN, f"{seen}, all but black", "take the cap off, make light")
    if look.rate_hz < 0.8 * config.fps:
        says = f"{seen} instead of {config.fps}"
        return Finding(name, WARN, says, "more light, or a lower camera.fps")
    return Finding(name, OK, seen)


def check_mount(mount: Mount) -> Finding:
    """Whether the camera looks as the policies expect."""
    name, nominal = "camera mount", Mount()
    if mount == nominal:
        says = "not measured: the nominal mount is assumed"
        return Finding(name, WARN, says, "python -m robot calibrate camera")
    tilt_rad = mount.pitch_rad - nominal.pitch_rad
    lift_m = mount.height_m - nominal.height_m
    seen = f"{math.degrees(mount.pitch_rad):.1f}° down, {1e3 * mount.height_m:.0f} mm high"
    if abs(tilt_rad) <= PITCH_TOLERANCE_RAD and abs(lift_m) <= HEIGHT_TOLERANCE_M:
        return Finding(name, OK, seen)
    return Finding(
        name,
        WARN,
        f"{seen}; the policies were trained for about {math.degrees(nominal.pitch_rad):.1f}° and "
        f"{1e3 * nominal.height_m:.0f} mm",
        f"tilt it {'up' if tilt_rad > 0.0 else 'down'} by {abs(math.degrees(tilt_rad)):.1f}°, "
        f"{'lower' if lift_m > 0.0 else 'raise'} it by {abs(1e3 * lift_m):.0f} mm, then calibrate "
        "again",
    )


def check_disk(machine: Machine, recording: Optional[RecordingConfig]) -> Finding:
    """Whether there is room, and for recordings, where there are any."""
    place = Path(recording.folder if recording else ".").resolve()
    while not place.exists():
        place = place.parent
    free_mb = machine.free_bytes(place) / MB
    says = f"{free_mb / 1e3:.1f} GB free at {place}"
    least_mb = max(LEAST_MB, recording.keep_free_mb if recording else 0.0)
    if free_mb < least_mb + ROOM_MB:
        level = FAIL if free_mb < least_mb else WARN
        return Finding("disk", level, says, "delete old recordings, or none can be made")
    return Finding("disk", OK, says)


def check_heat(machine: Machine) -> Finding:
    """The warmest thermometer."""
    readings = machine.temperatures_c()
    if not readings:
        return Finding("temperature", OK, "this computer tells none")
    name, celsius = max(readings.items(), key=lambda item: item[1])
    says = f"{celsius:.0f} °C ({name})"
    if celsius >= WARM_C:
        level = FAIL if celsius >= HOT_C else WARN
        return Finding("temperature", level, says, "give the heat sink air or a fan")
    return Finding("temperature", OK, says)
