"""A TB6612FNG bridge: what its two motor outputs do, from its three inputs (Toshiba data sheet)."""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple

from sim_pybullet.virtual.pwm import PwmOutputs


class BridgeState(Enum):
    """What the outputs do."""

    CW = "OUT1 high, OUT2 low"
    CCW = "OUT1 low, OUT2 high"
    SHORT_BRAKE = "both low: the winding is shorted, its current goes round and decays slowly"
    STOP = "high impedance: the current flows back into the supply and is gone soon"


H, L = True, False
# "H-SW Control Function" of the data sheet: IN1, IN2, PWM -> outputs, with STBY high as on the
# boards. The sheet lists two low inputs with PWM high only; none of the four transistors conducts.
H_SW_CONTROL = {
    (H, H, H): BridgeState.SHORT_BRAKE,
    (H, H, L): BridgeState.SHORT_BRAKE,
    (L, H, H): BridgeState.CCW,
    (L, H, L): BridgeState.SHORT_BRAKE,
    (H, L, H): BridgeState.CW,
    (H, L, L): BridgeState.SHORT_BRAKE,
    (L, L, H): BridgeState.STOP,
    (L, L, L): BridgeState.STOP,
}


class Span(NamedTuple):
    """A part of the PWM period in which the outputs do not change."""

    share: float
    state: BridgeState


def bridge_state(in1: bool, in2: bool, pwm: bool, stby: bool = True) -> BridgeState:
    """The control function; in standby all outputs are high impedance."""
    return H_SW_CONTROL[in1, in2, pwm] if stby else BridgeState.STOP


def bridge_spans(outputs: PwmOutputs, in1: int, in2: int, pwm: int) -> tuple[Span, ...]:
    """The PWM period, from the PCA9685 channels wired to IN1, IN2 and PWM."""
    return tuple(
        Span(share, bridge_state(*levels)) for share, levels in outputs.spans(in1, in2, pwm)
    )
