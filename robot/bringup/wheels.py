"""The calibrations for which the robot must move: what a person sees, and the figures from it."""

import math
from dataclasses import replace
from typing import Any, Callable, Dict, Tuple

from robot.bringup.roller import Prompts, Roller
from robot.errors import ConfigError
from robot.hat.config import HatConfig

Values = Dict[Tuple[str, ...], Any]  # as `robot.cli.calibrate.edit_yaml` takes them

SCALE_RANGE = (0.8, 1.25)  # of a length that somebody has measured with a ruler
MOST_BEND_RAD = math.radians(60.0)  # of a drive that should be straight
DRIVE_M = 1.5
SPOT_TURNS = 5
SPEED_MPS = 0.08
Guide = Callable[[Roller, Prompts], Values]


def trim_from_drive(hat: HatConfig, rolled_m: float, ahead_m: float, left_m: float) -> Values:
    """Gains of the wheels and their radius, from where a straight drive ended.

    The robot rolls a circle when one wheel is larger. Its chord from the start to
    (``ahead_m``, ``left_m``), by the axes of the start, gives the bend; the bend times the baseline
    is what the right wheel rolled farther than the left one. ``rolled_m`` is the way of both by
    their steps. ConfigError: no two wheels differ so much.
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
    radius_m = round(hat.drive.wheel_radius_m * scale, 6)
    values: Values = {("hat", "drive", "wheel_radius_m"): radius_m}
    for side, motor, gain in (("left", hat.left, left / mean), ("right", hat.right, right / mean)):
        # The whole section: a file that says nothing of a motor has no place for its gain alone.
        for name, value in vars(replace(motor, gain=round(gain, 5))).items():
            values["hat", side, name] = value
    return values


def baseline_from_turns(hat: HatConfig, turned_rad: float, beyond_rad: float) -> Values:
    """Distance of the wheels, when ``turned_rad`` by steps were so much more; or ConfigError."""
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


def guide_trim(roller: Roller, person: Prompts) -> Values:
    """On the floor: a straight drive, and where it ended."""
    free = f"its axle's middle marked, with {DRIVE_M + 0.5:g} m free ahead"
    _start(person, f"Is the robot on the floor along a straight line, {free}?")
    way_m = 0.5 * sum(roller.roll(DRIVE_M, DRIVE_M, SPEED_MPS))
    person.tell(f"By its steps it drove {100 * way_m:.1f} cm. Measure the axle's middle again.")
    ahead_m = person.number("How many cm AHEAD along the line is it?") / 100.0
    left_m = person.number("How many cm to the LEFT of the line (right: negative)?") / 100.0
    return trim_from_drive(roller.config, way_m, ahead_m, left_m)


def guide_baseline(roller: Roller, person: Prompts) -> Values:
    """On the floor: turns on the spot, and how far beyond the last one it looks."""
    _start(person, "Does the robot stand on the floor along a straight line, with room to turn?")
    baseline_m = roller.config.drive.baseline_m
    way_m = math.pi * baseline_m * SPOT_TURNS
    person.tell(f"It turns to the LEFT {SPOT_TURNS} times now.")
    left_m, right_m = roller.roll(-way_m, way_m, SPEED_MPS)
    turned_rad = (right_m - left_m) / baseline_m
    beyond = person.number("How many DEGREES beyond the line does it look (too short: negative)?")
    short_rad = turned_rad - 2.0 * math.pi * SPOT_TURNS
    return baseline_from_turns(roller.config, turned_rad, math.radians(beyond) - short_rad)


def _start(person: Prompts, question: str) -> None:
    if not person.agrees(question):
        raise ConfigError("expected a yes; prepare it and start again")


GUIDES: Dict[str, Guide] = {"trim": guide_trim, "baseline": guide_baseline}
