"""``RoadAhead``: all that the rules of the road know of others, whoever told it.

Pictures or overhead poses fill it in; a rule never sees either.
"""

import math
from dataclasses import dataclass
from typing import Optional, Tuple

from robot.errors import ContractError


@dataclass(frozen=True)
class AtJunction:
    """One robot at a junction: at its line, or inside."""

    arm: int  # where it came from, 0 to 3 counter-clockwise; the next one is on its right
    arrived_s: float  # since when it stands at its line, on the clock of who tells
    name: str  # "" is whoever may be there, where nobody tells
    inside: bool = False


@dataclass(frozen=True)
class Junction:
    """Who is at the junction ahead, or inside it. ``own`` stands at its line, or is inside."""

    own: AtJunction
    others: Tuple[AtJunction, ...] = ()


@dataclass(frozen=True)
class RoadAhead:
    """What lies before the robot, else an empty road; ContractError for a deviation below 0."""

    # From the nose, along the own lane, to the nearest thing on it; below 0 or NaN it must stand.
    free_m: float = math.inf
    free_sigma_m: float = 0.0  # standard deviation of that
    coming_mps: float = 0.0  # how fast the thing itself comes nearer; below 0 it goes away
    line_m: Optional[float] = None  # from the nose to the next red line; None: none is known
    red_light: bool = False  # at that line; False where none is told, too
    junction: Optional[Junction] = None

    def __post_init__(self) -> None:
        if not self.free_sigma_m >= 0.0:
            raise ContractError(f"free_sigma_m: expected 0 m or more, got {self.free_sigma_m}")
