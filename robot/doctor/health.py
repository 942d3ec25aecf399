"""Disk, heat, throttling and time."""

from __future__ import annotations

import datetime
from pathlib import Path
from typing import Optional

from robot.config import RecordingConfig
from robot.doctor.findings import Finding, fail, ok, warn
from robot.doctor.machine import Machine

MB = 1e6
LEAST_MB, ROOM_MB = 200.0, 500.0  # that a system needs; for some hours of recording
WARM_C, HOT_C = 75.0, 90.0  # a Nano throttles from 97 on, and switches off at 103
NO_THERMOMETER = "PMIC-Die"  # of a Nano always reads 100
ALLOWED_SHARE = 0.9  # of the processor's highest frequency
EARLIEST = datetime.datetime(2026, 1, 1, tzinfo=datetime.timezone.utc)


def check_disk(machine: Machine, recording: Optional[RecordingConfig]) -> Finding:
    """Whether there is room, and for recordings, where there are any."""
    place = Path(recording.folder if recording else ".").resolve()
    while not place.exists():
        place = place.parent
    free_mb = machine.free_bytes(place) / MB
    says = f"{free_mb / 1e3:.1f} GB free at {place}"
    least_mb = max(LEAST_MB, recording.keep_free_mb if recording else 0.0)
    if free_mb < least_mb:
        return fail("disk", says, "delete old recordings: nothing more can be recorded")
    if free_mb < least_mb + ROOM_MB:
        return warn("disk", says, "delete old recordings soon")
    return ok("disk", says)


def check_heat(machine: Machine) -> Finding:
    """The warmest thermometer."""
    readings = {n: t for n, t in machine.temperatures_c().items() if n != NO_THERMOMETER}
    if not readings:
        return ok("temperature", "this computer tells none")
    name, celsius = max(readings.items(), key=lambda item: item[1])
    says = f"{celsius:.0f} °C ({name})"
    if celsius >= HOT_C:
        return fail("temperature", says, "switch it off; the processor needs a fan")
    if celsius >= WARM_C:
        return warn("temperature", says, "give the heat sink air or a fan")
    return ok("temperature", says)


def check_throttling(machine: Machine) -> Finding:
    """Whether the processor may run as fast as it can."""
    slowed = [
        (allowed, possible)
        for allowed, possible in machine.frequencies_khz()
        if allowed < ALLOWED_SHARE * possible
    ]
    if slowed:
        allowed, possible = slowed[0]
        return warn(
            "throttling",
            f"{len(slowed)} cores held to {allowed / 1e6:.2f} of {possible / 1e6:.2f} GHz",
            "sudo nvpmodel -m 0; a Nano needs 5 V and 4 A at its barrel jack (jumper J48)",
        )
    known = bool(machine.frequencies_khz())
    return ok("throttling", "none" if known else "this computer tells nothing of it")


def check_clock(machine: Machine) -> Finding:
    """Whether recordings get the right date. Driving does not depend on it."""
    now = datetime.datetime.fromtimestamp(machine.wall_time_s(), datetime.timezone.utc)
    says = f"{now:%Y-%m-%d %H:%M} UTC"
    remedy = "connect it to the network, or: sudo date -s '2026-01-31 12:00'; recordings are dated"
    if now < EARLIEST:
        return warn("clock", f"{says}: it lost its time without power", remedy)
    if machine.time_is_synchronised() is False:
        return warn("clock", f"{says}, no time server heard yet", remedy)
    return ok("clock", says)
