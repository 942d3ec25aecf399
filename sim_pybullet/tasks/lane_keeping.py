"""``LaneKeeping``: drive along one lane of a ring of road (paper A, section 3.2)."""

from collections.abc import Sequence
from functools import partial

import numpy as np

from robot.errors import ConfigError
from robot.geometry import Pose
from robot.navigation.map_objects import blocked
from robot.navigation.path import Path, lane_loop
from robot.navigation.road_map import RoadMap
from sim_pybullet.tasks.following import (
    DAWDLE,
    HALF_LANE_TILES,
    NOMINAL_STEP_M,
    TERM_NAMES,
    following_terms,
)
from sim_pybullet.tasks.spec import (
    Choices,
    Mission,
    PaperRow,
    Task,
    TaskSpec,
    TaskStep,
    expect_some,
    register,
)
from sim_pybullet.vehicle import WheeledRobots

LANES = ("outer", "inner", "both")
LAPS = 2.0
_CLEAR_M = 0.3  # nobody begins nearer to what stands in the lane
_PRACTICE_LAPS = 0.5  # more places, looks and bends for as many decisions


class LaneKeeping(Task):
    """Drive ``laps`` laps along the middle of the outer lane, or of the inner one, or either.

    Traffic keeps right: the outer lane goes round counter-clockwise, the inner one clockwise. An
    episode begins at a random place of the lane, a little off its middle and its direction. The
    reward is that of `sim_pybullet.tasks.following.following_terms`.

    Terminated: more than half a lane (0.19 tiles) from the middle, more than 100 degrees off, or in
    collision. Truncated: all laps driven (success), or twice the time that they take at full speed.

    ConfigError for no maps, robots, laps or such lane; MapError for a map that is no ring of road.
    """

    term_names: tuple[str, ...] = TERM_NAMES
    fact_names: tuple[str, ...] = ("laps",)

    def __init__(
        self,
        road_maps: Sequence[RoadMap],
        n_robots: int,
        lane: str = "outer",
        laps: float = LAPS,
        start_spread: float = 1.0,
    ) -> None:
        expect_some("LaneKeeping", road_maps, n_robots, laps)
        if lane not in LANES:
            raise ConfigError(f"lane: expected outer, inner or both, got {lane!r}")
        sides = ("outer", "inner") if lane == "both" else (lane,)
        self._loops = [[lane_loop(m, outer=side == "outer") for side in sides] for m in road_maps]
        self._blocked_m = [blocked(road_map).points_m for road_map in road_maps]
        half_lanes_m = np.array([HALF_LANE_TILES * m.tile_size_m for m in road_maps])
        vehicle = WheeledRobots(n_robots)
        super().__init__(
            road_maps, vehicle, n_robots, half_lanes_m, self._loops[0][0], start_spread
        )
        self._laps = laps

    def _mission(self, road_map: int, rng: np.random.Generator, turn: int | None) -> Mission:
        loops = self._loops[road_map]
        loop = loops[int(rng.integers(len(loops))) if turn is None else turn % len(loops)]
        while True:
            arc_m = rng.uniform(0.0, loop.length_m)
            away_m = self._blocked_m[road_map] - loop.pose_at(arc_m)[:2]
            if (np.hypot(*away_m.T) > _CLEAR_M).all():
                return loop, arc_m

    def _path_from(self, pose: Pose, rng: np.random.Generator) -> Path:  # noqa: ARG002
        loops = self._loops[0]
        return min(loops, key=lambda loop: abs(loop.project(pose.x_m, pose.y_m).offset_m))

    def step(self, poses: np.ndarray, collided: np.ndarray) -> TaskStep:
        """Reward and end of the decision that led to poses (N, 3)."""
        (course, lost), half_lane_m = self._follow(poses), self.half_lane_m
        laps = course.travelled_m / self._lengths_m
        terminated = collided | lost | (np.abs(course.offset_m) > half_lane_m)
        late = self._steps * NOMINAL_STEP_M >= DAWDLE * self._laps * self._lengths_m
        terms = following_terms(course, half_lane_m)
        return self._judged(terms, laps[None], (terminated, laps >= self._laps, late))


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
