"""From what a person measured to the figures of the wheels. Pure."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, Dict, Tuple

from robot.errors import ConfigError
from robot.hat.config import GAIN_MAX, HatConfig

Values = Dict[Tuple[str, ...], Any]  # as `robot.bringup.yaml_edit.edit_yaml` takes them

# Full steps per turn that motors are made with; a count this near to one of them is that one.
COMMON_STEPS = (20, 24, 48, 96, 100, 180, 200, 240, 400, 2048, 4096)
NEAR_COMMON = 0.015
STEPS_RANGE = (4.0, 20_000.0)
SCALE_RANGE = (0.8, 1.25)  # of a length that somebody has measured with a ruler
MOST_BEND_RAD = math.radians(60.0)  # of a drive that should be straight


def steps_from_turns(hat: HatConfig, commanded_turns: float, seen_turns: float) -> Values:
    """Full steps per turn, when ``commanded_turns`` by the present figure were ``seen_turns``.

    Raises:
        ConfigError: no motor has so many steps.
    """
    if not seen_turns > 0.0:
        raise ConfigError(f"turns: expected a positive number, got {seen_turns:g}")
    steps = hat.steps_per_rev * commanded_turns / seen_turns
    near = min(COMMON_STEPS, key=lambda common: abs(steps / common - 1.0))
    if abs(steps / near - 1.0) <= NEAR_COMMON:
        steps = float(near)
    if not STEPS_RANGE[0] <= steps <= STEPS_RANGE[1]:
        raise ConfigError(
            f"steps per turn: expected {STEPS_RANGE[0]:g} to {STEPS_RANGE[1]:g}, got {steps:g} "
            f"from {seen_turns:g} turns instead of {commanded_turns:g}; count again"
        )
    return {("hat", "steps_per_rev"): round(steps, 2)}


def trim_from_drive(hat: HatConfig, rolled_m: float, ahead_m: float, left_m: float) -> Values:
    """Gains of the wheels and their radius, from where a straight drive ended.

    The robot rolls a circle when one wheel is larger. Its chord from the start to
    (``ahead_m``, ``left_m``), by the axes of the start, gives the bend; the bend times the baseline
    is what the right wheel rolled farther than the left one.

    Args:
        hat: as it was driven with.
        rolled_m: way of both wheels by their steps.
        ahead_m: measured ahead of the start.
        left_m: measured to the left of it, negative to the right.

    Raises:
        ConfigError: no two wheels differ so much.
    """
    bend_rad = 2.0 * math.atan2(left_m, ahead_m)
    if not (ahead_m > 0.0 and abs(bend_rad) <= MOST_BEND_RAD):
        raise ConfigError(
            f"straight drive: expected to end ahead, bent by at most "
            f"{math.degrees(MOST_BEND_RAD):.0f}°, got {ahead_m:g} m ahead and {left_m:g} m to the "
            f"left, {math.degrees(bend_rad):.1f}°; does a wheel drag or slip on its axle?"
        )
    half = 0.5 * bend_rad
    way_m = math.hypot(ahead_m, left_m) * (half / math.sin(half) if half else 1.0)
    difference = bend_rad * hat.drive.baseline_m / way_m
    left = hat.left.gain * (1.0 - 0.5 * difference)
    right = hat.right.gain * (1.0 + 0.5 * difference)
    mean = 0.5 * (left + right)
    scale = way_m / rolled_m * mean
    _expect_scale("wheel radius", scale, f"{way_m:.3f} m instead of {rolled_m:.3f} m")
    gains = (left / mean, right / mean)
    if max(gains) > GAIN_MAX or min(gains) < 1.0 / GAIN_MAX:
        raise ConfigError(
            f"trim: expected gains up to {GAIN_MAX:g}, got {gains[0]:.3f} and {gains[1]:.3f} from "
            f"{1e3 * left_m:.0f} mm to the left; look for a wheel that slips or drags"
        )
    radius_m = round(hat.drive.wheel_radius_m * scale, 6)
    values: Values = {("hat", "drive", "wheel_radius_m"): radius_m}
    for side, motor, gain in (("left", hat.left, gains[0]), ("right", hat.right, gains[1])):
        # The whole section: a file that says nothing of a motor has no place for its gain alone.
        for name, value in vars(replace(motor, gain=round(gain, 5))).items():
            values["hat", side, name] = value
    return values


def baseline_from_turns(hat: HatConfig, turned_rad: float, beyond_rad: float) -> Values:
    """Distance of the wheels, when ``turned_rad`` by steps were so much more on the floor.

    Raises:
        ConfigError: the baseline would be far from the present one.
    """
    true_rad = turned_rad + beyond_rad
    scale = turned_rad / true_rad if true_rad else math.inf
    turns = true_rad / (2.0 * math.pi)
    _expect_scale("baseline", scale, f"{turns:.2f} turns, {math.degrees(beyond_rad):.0f}° beyond")
    return {("hat", "drive", "baseline_m"): round(hat.drive.baseline_m * scale, 6)}


def _expect_scale(what: str, scale: float, got: str) -> None:
    if not SCALE_RANGE[0] <= scale <= SCALE_RANGE[1]:
        raise ConfigError(
            f"{what}: expected {SCALE_RANGE[0]:g} to {SCALE_RANGE[1]:g} times the present one, got "
            f"{scale:.3f} ({got}); measure again, or mend hat.steps_per_rev first"
        )
