"""``RoadAhead``: all that the rules of the road know of others, whoever told it.

Pictures or overhead poses fill it in; a rule never sees either.
"""

import math
from dataclasses import dataclass
from typing import Optional, Tuple

from robot.errors import ContractError


@dataclass(frozen=True)
class AtJunction:
    """One robot at a junction: at its line, or inside.

    ``arm``: where it came from, 0 to 3 counter-clockwise; the next one is on its right.
    ``arrived_s``: since when it stands at its line, on the clock of who tells. ``name``: "" is
    whoever may be there, where nobody tells.
    """

    arm: int
    arrived_s: float
    name: str
    inside: bool = False


@dataclass(frozen=True)
class Junction:
    """Who is at the junction ahead, or inside it. ``own`` stands at its line, or is inside."""

    own: AtJunction
    others: Tuple[AtJunction, ...] = ()


@dataclass(frozen=True)
class RoadAhead:
    """What lies before the robot; the defaults are an empty road.

    ``free_m``: from the nose, along the own lane, to the nearest thing on it [m]; below 0 or NaN
    the robot must stand. ``free_sigma_m``: its standard deviation. ``coming_mps``: how fast the
    thing itself comes nearer; below 0 it goes away. ContractError for a deviation below 0.
    """

    free_m: float = math.inf
    free_sigma_m: float = 0.0
    coming_mps: float = 0.0
    line_m: Optional[float] = None  # from the nose to the next red line; None: none is known
    red_light: bool = False  # at that line; False where none is told, too
    junction: Optional[Junction] = None

    def __post_init__(self) -> None:
        if not self.free_sigma_m >= 0.0:
            raise ContractError(f"free_sigma_m: expected 0 m or more, got {self.free_sigma_m}")
