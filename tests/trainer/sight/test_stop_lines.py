"""Robots on missions obey the red lines: stands, misses and false stops against the true poses.

``CROSSINGS=1000 pytest -rP -m slow tests/trainer/sight/test_stop_lines.py`` prints figures as those
of docs/sight.md; without the number a few crossings are driven.
"""

from __future__ import annotations

import math
import os
from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from robot.contract import CONTROL_DT_S, MAX_WHEEL_MPS
from robot.inference.policy import OnnxPolicy, best_action
from robot.navigation.lane_view import LaneView
from robot.navigation.road_map import RoadMap, load_map
from robot.safety.governors import Road, Rule, StopLines, govern
from robot.safety.road_ahead import RoadAhead
from robot.safety.wheel_limits import limit_speed
from robot.vision.sight import OnnxSight
from sim_pybullet.batch import BatchWorld
from sim_pybullet.episodes import Looks
from sim_pybullet.look import NOMINAL
from sim_pybullet.randomise import load_look_sampler
from sim_pybullet.sensing.guidance_feed import PoseSources
from sim_pybullet.tasks.navigation import Navigation
from tests.thorough import THOROUGH, count
from trainer.division import division
from trainer.sight.cli import SHIPPED

NOSE_M, MAP_LINES_M, REST_M = 0.066, 0.12, 0.002
ROBOTS = 20
CROSSINGS = int(os.environ.get("CROSSINGS", count(10, 30)))


@dataclass
class Tally:
    """What happened at the red lines."""

    crossings: int = 0
    right: int = 0  # stood half a second with the nose 0 to 10 cm before the line
    false: int = 0  # stands before no line
    twice: int = 0  # misses that followed a miss
    driven_m: float = 0.0
    where_m: list[float] = field(default_factory=list)  # of the nose before the line, at each stand

    def __str__(self) -> str:
        low, middle, high = 100.0 * np.quantile(self.where_m or [math.nan], (0.005, 0.5, 0.995))
        return (
            f"{self.right} of {self.crossings} crossings right ({self.right / self.crossings:.1%}),"
            f" {200.0 * self.false / self.driven_m:.2f} false stops in 200 m of {self.driven_m:.0f}"
            f" m, {self.twice} missed twice in a row; nose {low:.1f}, {middle:.1f}, {high:.1f} cm"
            " before the line (0.5 %, median, 99.5 %)"
        )


@dataclass
class Robot:
    """One robot as the tally follows it."""

    rules: tuple[Rule, ...] = (StopLines(),)
    capped_mps: float = math.inf
    at_rest: int = 0  # decisions
    stood: bool = False
    missed: bool = False
    gap_m: float = math.inf
    came: bool = False  # from farther off: it did not begin at the line

    def follow(self, gap_m: float, moved_m: float, tally: Tally) -> None:
        """``gap_m``: from the true nose to the line that lies ahead in truth."""
        tally.driven_m += moved_m
        self.at_rest = self.at_rest + 1 if moved_m < REST_M and self.capped_mps == 0.0 else 0
        if self.at_rest == round(0.5 / CONTROL_DT_S):
            if self.came and gap_m < 0.2:
                tally.where_m.append(gap_m)
            tally.false += gap_m > 0.2
            self.stood |= 0.0 <= gap_m <= 0.1
        self.came |= 0.2 < gap_m < 1.0
        if self.came and -0.06 < gap_m <= -0.03 < self.gap_m < 0.1:
            tally.crossings += 1
            tally.right += self.stood
            tally.twice += self.missed and not self.stood
            self.missed, self.stood, self.came = not self.stood, False, False
        self.gap_m = gap_m


def drive(
    maps: list[RoadMap], looks: Looks, sources: PoseSources, crossings: int, seed: int = 7000
) -> Tally:
    """Missions of the shipped navigator until so many lines were crossed."""
    policy = OnnxPolicy(SHIPPED.with_name("nav_ppo.onnx"))
    views = [LaneView(road_map) for road_map in maps]
    world = BatchWorld(
        Navigation(maps, ROBOTS), looks, policy.contract.image, seed, 1, sources=sources
    )
    observation, tally, robots = world.reset(), Tally(), [Robot() for _ in range(ROBOTS)]
    driven_m, now_s = np.zeros(ROBOTS), 0.0
    before = world.poses.copy()
    while tally.crossings < crossings:
        now_s += CONTROL_DT_S
        values = policy.values(observation.image, observation.path)
        wheels = np.zeros((ROBOTS, 2))
        for i, robot in enumerate(robots):
            within_m = world.guidance._fusion.certainty[i, 0]
            believed, sure = world.guidance.poses[i], within_m <= MAP_LINES_M
            ahead_m = views[world.maps[i]].line_ahead_m(believed) if sure else math.inf
            line_m = ahead_m - NOSE_M if math.isfinite(ahead_m) else None
            road = Road(now_s, float(driven_m[i]), robot.capped_mps, RoadAhead(line_m=line_m))
            robot.rules, cap = govern(robot.rules, road)
            robot.capped_mps = cap.most_mps
            wanted = policy.contract.wheels(best_action(values[i]) or 0)
            wheels[i] = limit_speed(wanted, min(cap.most_mps, MAX_WHEEL_MPS))
        step = world.step(wheels / MAX_WHEEL_MPS)
        driven_m += world.task.vehicle.counted[:, 0] * CONTROL_DT_S
        moved_m = np.hypot(*(step.poses - before)[:, :2].T)
        where, ended = world.maps, step.finished.robots.tolist()
        for i, robot in enumerate(robots):
            if i in ended:
                robots[i] = Robot()
                continue
            gap_m = views[where[i]].line_ahead_m(step.poses[i]) - NOSE_M
            robot.follow(gap_m, float(moved_m[i]), tally)
        observation, before = step.observation, world.poses.copy()
    world.close()
    return tally


def test_robots_that_know_their_place_stand_at_every_line() -> None:
    tally = drive([load_map("town")], [replace(NOMINAL)], PoseSources(), 16)
    print(tally)
    assert tally.right == tally.crossings
    assert tally.false == 0


@pytest.mark.slow
@pytest.mark.parametrize("look", ["randomised", "reality"][: count(1, 2)])
@pytest.mark.parametrize("overhead", ["start", "always"] if THOROUGH else ["start"])
def test_robots_with_sight_stand_at_nearly_every_line(look: str, overhead: str) -> None:
    maps = [load_map(name) for name in division().maps.judging]
    looks = load_look_sampler(look)
    sources = PoseSources(overhead, OnnxSight(SHIPPED))
    tally = drive(maps, looks, sources, CROSSINGS)
    print(f"{look}, overhead poses {overhead}: {tally}")
    assert tally.right >= 0.9 * tally.crossings
