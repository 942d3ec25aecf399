"""Limits on what is asked of the wheels: pure functions from wanted to allowed.

The figures leave the whole action table free, so that a policy drives for real as it did in
simulation; they catch what no policy asks for.
"""

import math
from typing import NamedTuple

from robot.contract import CONTROL_DT_S, MAX_WHEEL_MPS
from robot.errors import ContractError
from robot.geometry import WheelSpeeds
from robot.safety.governors import Cap

# From rest to the table's fastest wheel within one decision, and a quarter more.
MAX_WHEEL_MPS2 = 1.25 * MAX_WHEEL_MPS / CONTROL_DT_S  # 4.3 m/s^2


def limit_speed(wanted: WheelSpeeds, most_mps: float = MAX_WHEEL_MPS) -> WheelSpeeds:
    """The same curve, no wheel faster than ``most_mps`` [m/s]; ContractError: speeds not finite."""
    _check_finite(wanted)
    fastest_mps = max(abs(speed) for speed in wanted)
    if fastest_mps <= most_mps:
        return wanted
    scale = most_mps / fastest_mps
    return WheelSpeeds(wanted.left_mps * scale, wanted.right_mps * scale)


def limit_rate(wanted: WheelSpeeds, last: WheelSpeeds, dt_s: float) -> WheelSpeeds:
    """``wanted``, but each wheel at most `MAX_WHEEL_MPS2` x ``dt_s`` away from ``last``.

    Only for driving: a stop is a stop, and never goes through here. ContractError for a speed or a
    time step that is NaN, infinite or negative.
    """
    _check_finite(wanted)
    _check_finite(last)
    if not 0.0 <= dt_s < math.inf:
        raise ContractError(f"dt_s: expected a time step of 0 s or more, got {dt_s}")
    step_mps = MAX_WHEEL_MPS2 * dt_s
    return WheelSpeeds(*(min(max(w, v - step_mps), v + step_mps) for w, v in zip(wanted, last)))


class Drive(NamedTuple):
    """What the wheels were asked for in one turn, and what limits it."""

    wanted: WheelSpeeds  # of the policy or of a person [m/s]
    before: WheelSpeeds  # as told in the turn before [m/s]
    dt_s: float  # since then
    cap: Cap = Cap()  # of the rules of the road

    def limited(self, max_wheel_mps: float) -> WheelSpeeds:
        """What the motors are told [m/s]; ContractError for what is not finite."""
        most_mps = min(max_wheel_mps, self.cap.most_mps)
        return limit_rate(limit_speed(self.wanted, most_mps), self.before, self.dt_s)


def _check_finite(wheels: WheelSpeeds) -> None:
    if not all(math.isfinite(speed) for speed in wheels):
        raise ContractError(f"wheel speeds: expected two finite numbers [m/s], got {tuple(wheels)}")
