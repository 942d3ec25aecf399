"""Switch every output of the motor HAT off, whatever ran before; the wheels turn freely then.

systemd runs this after the robot's program, however that ended: the chip has no watchdog, and would
heat the coils of a robot that was killed. It imports smbus2 and little else.
"""

from __future__ import annotations

import argparse
import os
from typing import List

from robot.errors import HardwareError
from robot.hat.bus import I2cBus, SmbusBus
from robot.hat.clock import Clock, MonotonicClock
from robot.hat.pca9685 import Pca9685

BUSES = (1, 7)  # pins 3 and 5 of a Jetson Nano, of an Orin Nano
ADDRESSES = (0x6F, 0x60)
ATTEMPTS = 3


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The command's options."""
    parser.add_argument(
        "--bus", type=int, help="number of /dev/i2c-N; without it 1 and 7 are tried"
    )
    parser.add_argument(
        "--address",
        type=_address,
        action="append",
        help="of the HAT, such as 0x6F; without it 0x6F and 0x60 are tried",
    )


def _address(text: str) -> int:
    address = int(text, 0)
    if not 0x40 <= address <= 0x77:
        raise argparse.ArgumentTypeError(f"expected 0x40 to 0x77, got {text}")
    return address


def run(options: argparse.Namespace) -> None:
    """Do it; HardwareError when no HAT was found, or one could not be switched off."""
    if options.bus is not None:
        numbers = [options.bus]
    else:
        numbers = [n for n in BUSES if os.path.exists(f"/dev/i2c-{n}")] or [BUSES[0]]
    told = [
        switch_off(SmbusBus(n), options.address or list(ADDRESSES), MonotonicClock())
        for n in numbers
    ]
    if not any(told):
        raise HardwareError(f"expected a HAT on bus {' or '.join(map(str, numbers))}, found none")
    for line in filter(None, told):
        print(line)


def switch_off(bus: I2cBus, addresses: List[int], clock: Clock) -> str:
    """All outputs of every HAT on ``bus`` low; what was done, "" when there is none.

    Raises:
        HardwareError: a HAT is there, but three attempts to write to it failed.
    """
    done = []
    for address in addresses:
        for attempt in range(1, ATTEMPTS + 1):
            try:
                chip = Pca9685.find(bus, address, clock)
                if chip is None:
                    break
                chip.all_off()
                done.append(f"0x{address:02X}")
                break
            except HardwareError as error:
                if attempt == ATTEMPTS:
                    raise HardwareError(f"cut the motor supply: {error}") from error
    return f"{bus.name}: all outputs off at {', '.join(done)}" if done else ""
