"""Which coils of a two-phase stepper carry how much, position by position around the ring.

The ring is the four bridge inputs [AIN2, BIN1, AIN1, BIN2]: energising each in turn moves the rotor
by one full step. Levels are PWM duties in [0, 1]; as the bridges do not regulate current, the duty
is what limits the voltage on a coil.
"""

from __future__ import annotations

import math
from typing import Tuple

Levels = Tuple[float, float, float, float]  # of AIN2, BIN1, AIN1, BIN2

FULL_STEPS = 4  # of one electrical turn
MICROSTEPS = (1, 2, 4, 8, 16)


def ring_size(microsteps: int) -> int:
    """Positions in one electrical turn when a full step is cut into ``microsteps``."""
    return FULL_STEPS * microsteps


def ring_levels(position: float, microsteps: int, duty: float) -> Levels:
    """The duties at a position counted in microsteps (any number; the ring repeats).

    The field's angle advances evenly and the stronger coil is always fully on, which gives more
    torque than a sine curve: 1 is two-phase full stepping, 2 the usual half-step table.
    """
    turn = (position + (0.5 if microsteps == 1 else 0.0)) / ring_size(microsteps)
    a, b = math.cos(2.0 * math.pi * turn), math.sin(2.0 * math.pi * turn)
    scale = duty / max(abs(a), abs(b))
    a, b = round(scale * a, 9), round(scale * b, 9)  # a coil that is off is exactly 0
    return (max(a, 0.0), max(b, 0.0), max(-a, 0.0), max(-b, 0.0))
