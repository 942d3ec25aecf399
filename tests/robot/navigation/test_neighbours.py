"""What a robot knows of the others by overhead poses: fresh, stale, or never heard."""

from __future__ import annotations

import functools
import math
from typing import Any, List, NamedTuple

import numpy as np
import pytest

from robot.geometry import Pose
from robot.link.messages import PoseMessage, Sighting
from robot.navigation.lane_view import LaneView
from robot.navigation.neighbours import AHEAD_M, Neighbours
from robot.navigation.path import Path
from robot.navigation.planner import LaneGraph, plan_path
from robot.navigation.road_map import load_map
from robot.navigation.road_watch import RoadWatch
from robot.safety.governors import Cap, Road, Rules, govern
from robot.safety.road_ahead import RoadAhead
from tests.robot.navigation.test_navigator import GOAL, TOWN, driving
from tests.robot.navigation.test_others import CROSS, WAITING
from tests.thorough import count


class OneView(LaneView):
    """Asked by each of several robots about the same poses, it answers once."""

    @functools.lru_cache(maxsize=64)  # noqa: B019
    def line_ahead_m(self, pose: Pose) -> float:
        return super().line_ahead_m(pose)


LOOP, VIEW = load_map("loop"), OneView(CROSS)
HERE = Pose(0.6, 0.1, 0.0)
WAY = np.stack((0.6 + AHEAD_M, 0.1 + 0.0 * AHEAD_M), axis=1)
NOSE_M, HALF_ROBOT_M, HALF_DUCK_M = 0.066, 0.09, 0.035
TURN_S = 0.1


class Above:
    """A localizer that tells true poses, ``late_s`` after each picture."""

    def __init__(self, neighbours: Neighbours, late_s: float = 0.0) -> None:
        self.neighbours, self.late_s = neighbours, late_s
        self.now_s, self.sequence = 20.0, 0

    def tell(self, **others: Pose) -> None:
        self.now_s += TURN_S
        self.sequence += 1
        stamp = (7.0 + self.now_s - self.late_s, "a" * 16, self.sequence, 7.0 + self.now_s)
        seen = {"me": HERE, **others}
        poses = [PoseMessage(name, *pose, 0.9, *stamp) for name, pose in seen.items()]
        self.neighbours.hear(poses, self.now_s)

    @property
    def ahead(self) -> RoadAhead:
        return self.neighbours.ahead(self.now_s, HERE, WAY)


@pytest.fixture
def above() -> Above:
    return Above(Neighbours(LaneView(LOOP), "me"))


def cap_of(ahead: RoadAhead) -> Cap:
    rules = Rules(headway=True).chain()
    return govern(rules, Road(0.0, 0.0, 0.3, ahead))[1]


def test_who_is_alone_has_a_free_road_and_who_hears_nothing_stands(above: Above) -> None:
    assert math.isnan(above.ahead.free_m), "nobody ever told it anything"
    above.tell()
    assert above.ahead.free_m == math.inf
    above.now_s += 0.9
    assert above.ahead.free_m == math.inf
    above.now_s += 0.2
    assert math.isnan(above.ahead.free_m)
    assert cap_of(above.ahead) == Cap(0.0, "nothing tells where the others are")
    above.tell()
    assert above.ahead.free_m == math.inf


@pytest.mark.parametrize(("name", "half_m"), [("other", HALF_ROBOT_M), ("duck3", HALF_DUCK_M)])
def test_the_way_to_another_is_from_nose_to_edge(name: str, half_m: float, above: Above) -> None:
    for k in range(10):
        above.tell(**{name: Pose(1.2 + 0.02 * k, 0.1, 0.0)})
    assert above.ahead.free_m == pytest.approx(0.6 + 0.18 - half_m - NOSE_M, abs=0.011)
    assert above.ahead.coming_mps == pytest.approx(-0.2)
    assert above.ahead.free_sigma_m == 0.03


@pytest.mark.parametrize(("step_m", "nearer_m"), [(0.02, 0.0), (-0.02, 0.1)])
def test_who_is_seen_no_longer_counts_where_it_was_and_where_it_may_be(
    step_m: float, nearer_m: float, above: Above
) -> None:
    for k in range(10):
        above.tell(other=Pose(1.4 + step_m * k, 0.1, 0.0))
    free_m = above.ahead.free_m
    for _ in range(5):
        above.tell()
    assert above.ahead.free_m == pytest.approx(free_m - nearer_m, abs=0.021)
    for _ in range(46):
        above.tell()
    assert above.ahead.free_m == math.inf, "it was taken away"


def test_who_comes_nearer_and_is_seen_no_longer_went_on_for_a_second(above: Above) -> None:
    for k in range(10):
        above.tell(other=Pose(1.4 - 0.02 * k, 0.1, 0.0))
    free_m = above.ahead.free_m
    for _ in range(30):
        above.tell()
    assert above.ahead.free_m == pytest.approx(free_m - 0.2, abs=0.021)


def test_a_pose_that_jumps_frees_no_road(above: Above) -> None:
    for _ in range(5):
        above.tell(other=Pose(1.2, 0.1, 0.0))
    free_m = above.ahead.free_m
    for _ in range(5):
        above.tell(other=Pose(1.2, 1.4, 0.0))
        assert above.ahead.free_m == free_m


def test_a_robot_on_a_mission_is_told_who_is_on_its_path() -> None:
    world = driving()
    assert world.guidance.ahead.free_m == math.inf
    path = plan_path(LaneGraph(TOWN), world.pose, GOAL)
    there = path.pose_at(path.project(*world.pose[:2]).arc_m + 0.5)
    world.others = (Sighting("other", *there, 0.9),)
    world.turn()
    assert world.guidance.ahead.free_m == pytest.approx(0.5 - HALF_ROBOT_M - NOSE_M, abs=0.02)
    for _ in range(9):
        world.turn(seen=False)
    assert math.isfinite(world.guidance.ahead.free_m)
    for _ in range(3):
        world.turn(seen=False)
    assert math.isnan(world.guidance.ahead.free_m)


class Car:
    """One that keeps all rules, and hears of the others late, or not at all."""

    def __init__(self, name: str, path: Path, begin_m: float) -> None:
        self.name, self.path, self.arc_m = name, path, begin_m
        self.neighbours = Neighbours(VIEW, name)
        self.watch = RoadWatch(VIEW, self.neighbours)
        self.rules = Rules(True, True, True).chain()
        self.told_mps = self.speed_mps = 0.0

    @property
    def pose(self) -> Pose:
        return self.path.pose_at(self.arc_m)

    @property
    def inside(self) -> bool:
        tile = CROSS.tile_at(*self.pose[:2])
        return tile is not None and tile.is_junction

    def turn(self, now_s: float) -> None:
        way_m = self.path.batch.points_at(self.arc_m + AHEAD_M[None])[0]
        ahead = self.watch.look(now_s, self.arc_m, (self.pose, 0.0), way_m)
        self.rules, cap = govern(self.rules, Road(now_s, self.arc_m, self.told_mps, ahead))
        self.told_mps = min(0.3, cap.most_mps)
        self.speed_mps += 0.6 * (self.told_mps - self.speed_mps)
        self.arc_m += TURN_S * self.speed_mps


@functools.lru_cache(maxsize=None)
def ways() -> List[List[Path]]:
    """All ways over the crossing, by the arm that they come from."""
    lanes = LaneGraph(CROSS).lanes
    middle = [lane for lane in lanes if (lane.tile.row, lane.tile.column) == (1, 1)]
    found: List[List[Path]] = [[], [], [], []]
    for over in middle:
        begin, end = over.control_points_m[0], over.control_points_m[3]
        (to,) = [e for e in lanes if np.allclose(e.control_points_m[3], begin)]
        (on,) = [e for e in lanes if np.allclose(e.control_points_m[0], end)]
        path = Path.from_beziers([each.control_points_m for each in (to, over, on)])
        arm = (round(path.headings_rad[0] / (0.5 * math.pi)) - 1) % 4
        found[arm].append(path)
    return found


def cross(seed: int, sigma_m: float, lost: float) -> float:
    """Four robots come to a crossing at about the same time; when the last is beyond it [s]."""
    rng = np.random.default_rng(seed)
    cars = [
        Car(f"r{arm}", paths[int(rng.integers(3))], float(rng.uniform(0.05, 0.3)))
        for arm, paths in enumerate(ways())
    ]
    on_the_way: List[List[PoseMessage]] = []
    for k in range(1200):
        now_s = 100.0 + TURN_S * k
        stamp = (now_s, "a" * 16, k, now_s)
        noise = sigma_m * rng.standard_normal((4, 2))
        poses = [car.pose for car in cars]
        on_the_way.append(
            [
                PoseMessage(c.name, p.x_m + n[0], p.y_m + n[1], p.heading_rad, 1, *stamp)
                for c, p, n in zip(cars, poses, noise)
            ]
        )
        for car in cars:
            if k >= 2 and rng.random() >= lost:
                car.neighbours.hear(on_the_way[k - 2], now_s)
            car.turn(now_s)
        assert sum(car.inside for car in cars) <= 1, f"two inside with seed {seed}"
        if all(car.arc_m > 1.35 for car in cars):
            return now_s - 100.0
    raise AssertionError(f"somebody waits for ever with seed {seed}")


@pytest.mark.slow
@pytest.mark.parametrize(("sigma_m", "lost"), [(0.0, 0.0), (0.003, 0.05)])
def test_four_robots_that_only_hear_the_localizer_pass_one_after_the_other(
    sigma_m: float, lost: float
) -> None:
    assert max(cross(seed, sigma_m, lost) for seed in range(2)) < 40.0


@pytest.mark.slow
def test_many_times_four_robots_pass() -> None:
    assert max(cross(seed, 0.003, 0.05) for seed in range(2, 2 + count(3, 40))) < 60.0


class Clear(NamedTuple):
    """Sight that always sees a free way."""

    def ahead(self, driven_m: float, now_s: float) -> RoadAhead:
        return RoadAhead()


def test_who_has_stood_inside_for_fifteen_seconds_is_in_the_way_until_it_moves() -> None:
    others = Neighbours(VIEW, "me")

    def inside(now_s: float, y_m: float = 0.9) -> List[bool]:
        stamp = (now_s, "a" * 16, round(10.0 * now_s), now_s)
        seen = {"me": WAITING[0], "other": Pose(1.02, y_m, 0.5 * math.pi)}
        others.hear([PoseMessage(name, *pose, 0.9, *stamp) for name, pose in seen.items()], now_s)
        junction = others.ahead(now_s, WAITING[0], WAY).junction
        assert junction is not None
        return [other.inside for other in junction.others]

    told = [inside(10.0 + TURN_S * k) for k in range(170)]
    assert told == [[True]] * 151 + [[]] * 19
    told = [inside(27.0 + TURN_S * k, 0.9 + 0.03 * k) for k in range(8)]
    assert told == [[]] * 7 + [[True]], "it moves: 20 cm"
    assert inside(29.0, 1.11) == [True]
    told = [inside(29.1 + TURN_S * k, 1.11) for k in range(155)]
    assert told[-1] == []
    assert inside(47.0, 1.11) == [True], "nobody knows whether it stood"


@pytest.mark.parametrize("seed", range(3))
def test_who_stands_inside_does_not_move_by_poses_that_err(seed: int) -> None:
    others, rng, told = Neighbours(VIEW, "me"), np.random.default_rng(seed), []
    for k in range(400):
        now_s = 10.0 + TURN_S * k
        stamp, (x_m, y_m) = (now_s, "a" * 16, k, now_s), rng.normal((1.02, 0.9), 0.03)
        seen = {"me": WAITING[0], "other": Pose(float(x_m), float(y_m), 0.5 * math.pi)}
        others.hear([PoseMessage(name, *pose, 0.9, *stamp) for name, pose in seen.items()], now_s)
        junction = others.ahead(now_s, WAITING[0], WAY).junction
        told.append(junction is not None and bool(junction.others))
    assert all(told[:150])
    assert not any(told[160:])


def test_a_duck_never_has_the_right_of_way_though_its_board_tells_a_heading() -> None:
    others = Neighbours(VIEW, "me")
    for k in range(5):
        now_s = 10.0 + TURN_S * k
        seen = {"me": WAITING[0], "duck1": Pose(1.02, 0.9, 0.5 * math.pi)}
        stamp = (now_s, "a" * 16, k, now_s)
        others.hear([PoseMessage(name, *pose, 0.9, *stamp) for name, pose in seen.items()], now_s)
    junction = others.ahead(now_s, WAITING[0], WAY).junction
    assert junction is not None
    assert junction.others == ()


def test_sight_alone_leads_nobody_into_a_junction() -> None:
    way: Any = Clear()
    path = ways()[0][0]
    watch = RoadWatch(VIEW, Neighbours(VIEW, "me"), way)
    for nose_m, goes in ((0.15, True), (0.55, False)):
        pose, rules = path.pose_at(nose_m - NOSE_M), Rules(True, True, True).chain()
        way_m = path.batch.points_at(nose_m - NOSE_M + AHEAD_M[None])[0]
        caps = []
        for k in range(60):
            ahead = watch.look(9.0 + TURN_S * k, 1.0, (pose, 0.0), way_m)
            rules, cap = govern(rules, Road(9.0 + TURN_S * k, 1.0, 0.0, ahead))
            caps.append(cap)
        assert (caps[-1].most_mps > 0.0) is goes
        assert goes or caps[-1].reason == "nothing tells who is at the junction"
