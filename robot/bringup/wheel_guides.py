"""Guiding a person through the calibrations for which the robot must move."""

from __future__ import annotations

import math
from typing import Callable, Dict

from robot.bringup.prompts import Prompts
from robot.bringup.roller import Roller
from robot.bringup.wheels import Values, baseline_from_turns, steps_from_turns, trim_from_drive
from robot.errors import ConfigError

WHEEL_TURNS = 10
DRIVE_M = 1.5
SPOT_TURNS = 5
SPEED_MPS = 0.08
Guide = Callable[[Roller, Prompts], Values]


def guide_steps(roller: Roller, person: Prompts) -> Values:
    """Wheels in the air: turns by the present figure against turns that a person counts."""
    _start(person, "Do both wheels hang free, and is the left tyre marked at the top?")
    turn_m = 2.0 * math.pi * roller.config.drive.wheel_radius_m
    person.tell(
        f"The left wheel makes {WHEEL_TURNS} turns now, if the figure is right. Count them."
    )
    way_m = WHEEL_TURNS * turn_m * roller.config.left.gain
    rolled = roller.roll(way_m, 0.0, SPEED_MPS)
    commanded = rolled.left_m / turn_m / roller.config.left.gain
    seen = person.number("How many turns was it (such as 9.75)?")
    return steps_from_turns(roller.config, commanded, seen)


def guide_trim(roller: Roller, person: Prompts) -> Values:
    """On the floor: a straight drive, and where it ended."""
    _start(
        person,
        f"Is the robot on the floor along a straight line, its axle's middle marked, with "
        f"{DRIVE_M + 0.5:g} m free ahead?",
    )
    rolled = roller.roll(DRIVE_M, DRIVE_M, SPEED_MPS)
    way_m = 0.5 * (rolled.left_m + rolled.right_m)
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
    rolled = roller.roll(-way_m, way_m, SPEED_MPS)
    turned_rad = (rolled.right_m - rolled.left_m) / baseline_m
    beyond = person.number(
        "How many DEGREES beyond the line does it look, to the left (too short: negative)?"
    )
    short_rad = turned_rad - 2.0 * math.pi * SPOT_TURNS
    return baseline_from_turns(roller.config, turned_rad, math.radians(beyond) - short_rad)


def _start(person: Prompts, question: str) -> None:
    if not person.agrees(question):
        raise ConfigError("expected a yes; prepare it and start again")


GUIDES: Dict[str, Guide] = {"steps": guide_steps, "trim": guide_trim, "baseline": guide_baseline}
