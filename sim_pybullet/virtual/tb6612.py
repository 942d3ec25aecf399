"""A TB6612FNG bridge: what its two motor outputs do, from its three inputs (Toshiba data sheet)."""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple

from sim_pybullet.virtual.pwm import PwmOutputs


class BridgeState(Enum):
    """The rows of the function table; STBY is tied high on the boards."""

    FORWARD = "O1 high, O2 low"
    REVERSE = "O1 low, O2 high"
    BRAKE = "both low: the winding is shorted"
    OPEN = "high impedance: no current"


class BridgeDrive(NamedTuple):
    """Averages over one PWM period."""

    voltage: float  # in [-1, 1] of the motor supply, positive for FORWARD
    closed: float  # share of the period in which current can flow


def bridge_state(in1: bool, in2: bool, pwm: bool) -> BridgeState:
    """The function table (data sheet, page 4)."""
    if in1 and in2:
        return BridgeState.BRAKE
    if not in1 and not in2:
        return BridgeState.OPEN
    if not pwm:
        return BridgeState.BRAKE
    return BridgeState.FORWARD if in1 else BridgeState.REVERSE


def bridge_drive(outputs: PwmOutputs, in1: int, in2: int, pwm: int) -> BridgeDrive:
    """The averages, from the PCA9685 channels wired to IN1, IN2 and PWM."""
    voltage = closed = 0.0
    for share, levels in outputs.spans(in1, in2, pwm):
        state = bridge_state(*levels)
        voltage += share * ((state is BridgeState.FORWARD) - (state is BridgeState.REVERSE))
        closed += share * (state is not BridgeState.OPEN)
    return BridgeDrive(voltage, closed)
