"""What the bridges' inputs carry at each position around a two-phase stepper's ring.

IN1 and IN2 say which way the current of a winding flows and stay as they are; the duty is on the
bridge's PWM input. Between the pulses a TB6612FNG then shorts the winding (data sheet, H-SW control
function: PWM low with one input high), so that its current goes on and its mean is duty * V / R.
With the duty on an input it would die between the pulses: a twentieth is left at half duty. A
winding without current has both inputs low.
"""

from __future__ import annotations

import math
from typing import Tuple

FULL_STEPS = 4  # of one electrical turn
MICROSTEPS = (1, 2, 4, 8, 16)  # into which a full step may be cut


def ring_levels(position: float, microsteps: int, duty: float) -> Tuple[float, ...]:
    """How much of the time each input is high, in the order of `robot.hat.config.Port`.

    The position is counted in microsteps (any number; the ring repeats). A full step forward turns
    the field from A (AIN2 high) to B (BIN1 high). Its angle advances evenly; the stronger winding
    always has the whole duty, which gives more torque than a sine curve: 1 is two-phase full
    stepping, 2 the usual half-step table. PWM inputs only differ from the duty between half steps,
    so that whole and half steps change nothing but directions.
    """
    turn = (position + (0.5 if microsteps == 1 else 0.0)) / (FULL_STEPS * microsteps)
    a, b = math.cos(2.0 * math.pi * turn), math.sin(2.0 * math.pi * turn)
    scale = duty / max(abs(a), abs(b))
    a, b = round(scale * a, 9), round(scale * b, 9)  # a winding without current has exactly 0
    on_a, on_b = float(a != 0.0), float(b != 0.0)
    forward_a, forward_b = float(a > 0.0), float(b > 0.0)
    inputs = (forward_a, on_a - forward_a, forward_b, on_b - forward_b)
    return (abs(a) or duty, *inputs, abs(b) or duty)
