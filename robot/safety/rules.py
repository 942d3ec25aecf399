"""``Rules``: which rules of the road a robot keeps, as its YAML file says."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Tuple

from robot.errors import ConfigError
from robot.safety.governors import KeepApart, Rule, StopLines
from robot.safety.right_of_way import FirstCome


@dataclass(frozen=True)
class Rules:
    """``rules`` of robot.yaml. ConfigError: right of way without the others, which it needs."""

    stop_lines: bool = False  # stand before each red line, then go on
    headway: bool = False  # stand before what is on the lane, and for want of who tells it
    right_of_way: bool = False  # at junctions: who came first, then who comes from the right

    def __post_init__(self) -> None:
        if self.right_of_way and not (self.stop_lines and self.headway):
            raise ConfigError(
                "rules.right_of_way: expected stop_lines and headway as well: it says who may go "
                "on from a line, and counts on poses of the others; add both, or leave it"
            )

    def chain(self) -> Tuple[Rule, ...]:
        """The rules that are asked for, as they begin."""
        every = (
            (self.headway, KeepApart()),
            (self.stop_lines, StopLines()),
            (self.right_of_way, FirstCome()),
        )
        return tuple(rule for asked, rule in every if asked)
