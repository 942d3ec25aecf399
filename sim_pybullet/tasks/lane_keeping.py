"""``LaneKeeping``: drive along one lane of a ring of road (paper A, section 3.2)."""

from collections.abc import Sequence
from functools import partial

import numpy as np

from robot.errors import expect_one_of
from robot.navigation.path import lane_loop
from robot.navigation.road_map import RoadMap
from sim_pybullet.tasks.following import Following
from sim_pybullet.tasks.spec import Choices, PaperRow, TaskSpec, TaskStep, expect_any, register

LANES = ("outer", "inner", "both")
LAPS = 2.0
_PRACTICE_LAPS = 0.5  # more places, looks and bends for as many decisions


class LaneKeeping(Following):
    """Drive ``laps`` laps along the middle of the outer lane, or of the inner one, or either.

    Traffic keeps right: the outer lane goes round counter-clockwise, the inner one clockwise. An
    episode begins at a random place of the lane, a little off its middle and its direction. The
    reward is that of `sim_pybullet.tasks.following.following_terms`.

    Terminated: more than half a lane (0.19 tiles) from the middle, more than 100 degrees off, or in
    collision. Truncated: all laps driven (success), or twice the time that they take at full speed.

    ConfigError for no maps, robots, laps or such lane; MapError for a map that is no ring of road.
    """

    fact_names: tuple[str, ...] = ("laps",)

    def __init__(
        self,
        road_maps: Sequence[RoadMap],
        n_robots: int,
        lane: str = "outer",
        laps: float = LAPS,
        start_spread: float = 1.0,
    ) -> None:
        expect_any("LaneKeeping", road_maps, n_robots, laps)
        expect_one_of("lane", lane, LANES)
        sides = ("outer", "inner") if lane == "both" else (lane,)
        loops = [[lane_loop(m, outer=side == "outer") for side in sides] for m in road_maps]
        super().__init__(road_maps, n_robots, loops, start_spread)
        self._laps = laps

    def step(self, poses: np.ndarray, collided: np.ndarray) -> TaskStep:
        """Reward and end of the decision that led to poses (N, 3)."""
        course, lost = self._follow(poses)
        laps = course.travelled_m / self._lengths_m
        failed = collided | lost | (np.abs(course.offset_m) > self.half_lane_m)
        return self._followed(laps[None], failed, laps >= self._laps, self._laps)


def _make(
    maps: Sequence[RoadMap], robots: int, chosen: Choices, usual_laps: float = LAPS
) -> LaneKeeping:
    usual = usual_laps if chosen.start_spread == 1.0 else _PRACTICE_LAPS
    laps = usual if chosen.laps is None else chosen.laps
    return LaneKeeping(maps, robots, chosen.lane or LANES[0], laps, chosen.start_spread)


_ON = "drives on until stopped"
register(
    TaskSpec(
        name="lane",
        title="Lane keeping",
        purpose="Lane keeping: follows its lane by its picture alone, with no pose.",
        kind=LaneKeeping,
        map="loop",
        make=_make,
        lanes=LANES,
        counts_laps=True,
        presets={"paper": {"net": {"image_fc": 512}}},
        paper={
            "ddqn": PaperRow("about 10,000", "2 M", _ON),
            "dueling": PaperRow("within 1 M", "2 M", _ON),
            "a2c": PaperRow("never steadily", "longer than the others", "unsteady"),
            "ppo": PaperRow("250,000 (steady from 550,000)", "not given", _ON),
        },
        environments={
            "LaneKeeping-v0": {},
            "LaneKeepingInner-v0": {"lane": "inner"},
            "LaneKeepingRandomised-v0": {"look": "randomised"},
        },
    )
)
for _name, _laps, _purpose in (
    ("four_laps", 4.0, "Lane keeping for four laps (paper A, section 4.4)."),
    ("hundred_laps", 100.0, "Lane keeping for an hour or so: unlimited, in paper A."),
):
    register(
        TaskSpec(
            name=_name,
            title=_name.replace("_", " ").capitalize(),
            purpose=_purpose,
            kind=LaneKeeping,
            map="loop",
            make=partial(_make, usual_laps=_laps),
            lanes=LANES,
            learned=False,
        )
    )
