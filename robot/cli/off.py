"""Switch every output of the motor HAT off, whatever ran before; the wheels turn freely then.

systemd runs this after the robot's program, however that ended: the chip has no watchdog, and would
heat the coils of a robot that was killed. It imports smbus2 and little else. It also works while
another program drives, which notices, stops, and stays off until a person clears its fault.
"""

import argparse
import os
from pathlib import Path
from typing import List, Optional, Tuple, Union

from robot.computer.clock import Clock, MonotonicClock
from robot.errors import ConfigError, HardwareError
from robot.hat.bus import USUAL_ADDRESSES, USUAL_BUSES, I2cBus, Pca9685, open_bus
from robot.typed_config import read_yaml

ATTEMPTS = 3
ROUNDS, ROUND_S = 10, 0.05  # a program that drives on notices within 0.1 s, and stops


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The command's options."""
    told = "the robot's YAML file, for its bus and addresses; else the usual ones are tried"
    parser.add_argument("--config", type=Path, help=told)


def run(options: argparse.Namespace) -> None:
    """Do it; HardwareError: no HAT, or one stays on; ConfigError: the usual ones are off alone."""
    wrong: Optional[Exception] = None
    buses: List[Union[int, str]] = [n for n in USUAL_BUSES if os.path.exists(f"/dev/i2c-{n}")]
    buses, addresses = buses or [USUAL_BUSES[0]], [*USUAL_ADDRESSES]
    if options.config is not None:
        try:
            bus, addresses = configured(options.config)
            buses = [bus]
        except ConfigError as error:  # switching off must not wait for somebody to mend it
            wrong = error
    told = []
    for each in buses:
        try:
            told.append(switch_off(open_bus(each), addresses, MonotonicClock()))
        except HardwareError as error:  # nor for the repair of another bus
            wrong = error  # graver than a wrong file: the coils may be on
    for line in filter(None, told):
        print(line, flush=True)
    if wrong is not None:
        raise wrong
    if not any(told):
        raise HardwareError(f"expected a HAT on bus {' or '.join(map(str, buses))}, found none")


def configured(path: Path) -> Tuple[Union[int, str], List[int]]:
    """Bus (or socket of a virtual one) and addresses of a file that may be wrong: ConfigError."""
    try:
        hat = read_yaml(path).get("hat") or {}
        bus = hat.get("socket") or int(hat.get("bus", USUAL_BUSES[0]))
        if not isinstance(hat.get("socket") or "", str):
            raise ValueError(f"socket {bus}, where the path of one is expected")
        addresses = [int(str(address), 0) for address in hat.get("addresses", USUAL_ADDRESSES)]
        if not all(0x40 <= address <= 0x77 for address in addresses):
            raise ValueError(f"addresses {addresses}, where 0x40 to 0x77 are a HAT's")
    except (ValueError, TypeError, AttributeError, OverflowError) as error:
        told = " ".join(str(error).split())
        raise ConfigError(f"{path}: expected a robot's YAML with its hat, got: {told}") from error
    return bus, addresses


def switch_off(bus: I2cBus, addresses: List[int], clock: Clock) -> str:
    """All outputs of every HAT on ``bus`` low; what was done, "" when there is none.

    HardwareError: a HAT is there, but three attempts to write to it failed, or somebody switches it
    on again and again.
    """
    done = []
    for address in addresses:
        for attempt in range(1, ATTEMPTS + 1):
            try:
                chip = Pca9685.find(bus, address, clock)
                if chip is None:
                    break
                _until_it_stays_off(chip, clock)
                done.append(f"0x{address:02X}")
                break
            except HardwareError as error:
                if attempt == ATTEMPTS:
                    raise HardwareError(f"cut the motor supply: {error}") from error
    return f"{bus.name}: all outputs off at {', '.join(done)}" if done else ""


def _until_it_stays_off(chip: Pca9685, clock: Clock) -> None:
    for _ in range(ROUNDS):
        chip.all_off()
        clock.sleep(ROUND_S)
        if chip.is_off():
            return
    raise HardwareError(f"{chip.bus.name}: another program switches the motors on again; end it")
