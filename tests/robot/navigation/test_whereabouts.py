"""A robot that is told nothing finds its place by driving and looking, or says that it cannot."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import List, NamedTuple, Optional, Tuple

import numpy as np
import pytest

from robot.errors import PlanError
from robot.geometry import Pose, between, wrap_angle
from robot.navigation.finding import Finding
from robot.navigation.lane_view import LaneAhead, LaneView
from robot.navigation.navigator import Glimpse, MissionNavigator
from robot.navigation.path import Path
from robot.navigation.planner import LaneGraph, path_on, plan_path
from robot.navigation.road_map import RoadMap, load_map
from robot.navigation.whereabouts import Place, Whereabouts, _likely
from robot.safety.state_machine import Command
from robot.vision.sight import Seen
from tests.robot.navigation.test_navigator import GRAPH, TOWN, driving
from tests.robot.navigation.test_sight_fix import FakeSight, seeing
from tests.robot.runtime.test_loop import Bench
from tests.thorough import count

STEP_M = 0.03
DEVIATIONS = np.array((0.015, 0.07, 0.6, 0.03))


def look(view: LaneView, pose: Pose, rng: np.random.Generator) -> Seen:
    """What sight would say at a pose, with its errors, missed lines and mistaken junctions."""
    road = view.at(*pose)
    assert road is not None
    figures = np.array((road.offset_m, road.heading_rad, road.curvature_pm, road.line_m))
    figures = np.nan_to_num(figures, posinf=0.3) + rng.normal(0.0, DEVIATIONS)
    line = float(0.12 <= road.line_m <= 0.45)
    if rng.random() < 0.1:
        line = 1.0 - line
    told = road.kind if road.line_m <= 0.6 else 0
    kinds = np.full(5, 0.025)
    kinds[int(rng.integers(5)) if rng.random() < 0.1 else told] = 0.9
    parts = (figures, DEVIATIONS, 0.05 + 0.9 * line, 0.97, kinds, 0.0)
    return Seen(*(np.asarray(part)[None] for part in parts))


def route(road_map: RoadMap, rng: np.random.Generator) -> Path:
    """A long way from anywhere."""
    graph = LaneGraph(road_map)
    while True:
        ends = [road_map.lanes[i].control_points_m for i in rng.integers(0, len(graph.lanes), 2)]
        start = Pose(*ends[0][0], math.atan2(*(ends[0][1] - ends[0][0])[::-1]))
        path = plan_path(graph, start, (float(ends[1][3][0]), float(ends[1][3][1])))
        if path.length_m > 2.5:
            return path


class Step(NamedTuple):
    """A decision's, which ends at ``pose``."""

    pose: Pose
    forward_m: float
    turn_rad: float


def steps_along(path: Path) -> List[Step]:
    """As a robot that keeps to the path makes them."""
    arcs_m = np.arange(0.0, path.length_m, STEP_M)
    x_m, y_m = (np.interp(arcs_m, path.arc_m, path.points_m[:, k]) for k in (0, 1))
    headings = np.interp(arcs_m, path.arc_m, np.unwrap(path.headings_rad))
    poses = np.column_stack((x_m, y_m, headings))
    moved = between(poses[:-1], poses[1:])
    return [
        Step(Pose(*to), float(by[0]), float(by[2])) for to, by in zip(poses[1:].tolist(), moved)
    ]


def drive(road_map: RoadMap, seed: int) -> Tuple[Whereabouts, Optional[Place], Pose]:
    """Along a random way, with wheels 3 % off, until the place is found; where it truly is."""
    rng, view = np.random.default_rng(seed), LaneView(road_map)
    path, search = route(road_map, rng), Whereabouts(LaneGraph(road_map), view)
    for k, (truth, forward_m, turn_rad) in enumerate(steps_along(path)):
        now_s = 0.1 * (k + 1)
        search.move(1.03 * forward_m, turn_rad, now_s)
        for place in search.see(look(view, truth, rng), now_s):
            return search, place, truth
    return search, None, truth


def found_right(seeds: range) -> List[bool]:
    """Whether each place was right that was found after at most three junctions."""
    right: List[bool] = []
    for seed in seeds:
        search, place, truth = drive(TOWN, seed)
        if place is None or search.junctions > 3:
            continue
        apart_m = math.dist(place[0][:2], truth[:2])
        turned = abs(float(wrap_angle(place[0].heading_rad - truth.heading_rad)))
        right.append(apart_m < 0.12 and turned < 0.35)
    return right


@pytest.mark.slow
def test_places_found_after_at_most_three_junctions_are_right() -> None:  # -rP shows how many
    drives = count(3, 20)
    right = found_right(range(drives))
    print(f"{sum(right)} of {len(right)} places found in {drives} drives were right")
    assert len(right) >= drives // 2
    assert sum(right) >= 0.95 * len(right)


def test_where_every_place_looks_alike_it_never_says_that_it_knows() -> None:
    loop = load_map("loop")
    view, search = LaneView(loop), Whereabouts(LaneGraph(loop), LaneView(loop))
    rng, lane = np.random.default_rng(1), loop.lanes[0].control_points_m
    pose = Pose(*lane[0], math.atan2(*(lane[1] - lane[0])[::-1]))
    told: List[int] = []
    for k in range(1, 40):
        search.move(0.0, 0.0, 0.1 * k)
        assert search.see(look(view, pose, rng), 0.1 * k) == ()
        told.append(search.places)
    assert told[-1] == told[10] > 4, "who stands sees nothing new"
    assert f"{search.places} places fit" in search.sentence


def lap(road_map: RoadMap, seed: int) -> Tuple[Whereabouts, Optional[Place], Pose]:
    """Along one lane of a ring until the place is found or 15 m are driven in vain."""
    rng, graph, view = np.random.default_rng(seed), LaneGraph(road_map), LaneView(road_map)
    control = graph.lanes[int(rng.integers(len(graph.lanes)))].control_points_m
    began = Pose(*control[0], math.atan2(*(control[1] - control[0])[::-1]))
    search = Whereabouts(graph, view)
    for k, (truth, forward_m, turn_rad) in enumerate(steps_along(path_on(graph, began, 16.0))):
        search.move(1.03 * forward_m, turn_rad, 0.1 * (k + 1))
        for place in search.see(look(view, truth, rng), 0.1 * (k + 1)):
            return search, place, truth
    return search, None, truth


@pytest.mark.slow
@pytest.mark.parametrize("name", ["rings/wedge", "rings/bean"][: count(1, 2)])
def test_a_ring_without_junctions_tells_the_place_by_its_bends(name: str) -> None:
    for seed in range(count(2, 10)):
        _, place, truth = lap(load_map(name), seed)
        assert place is not None
        assert math.dist(place[0][:2], truth[:2]) < 0.15
        assert abs(float(wrap_angle(place[0].heading_rad - truth.heading_rad))) < 0.35


@pytest.mark.slow
@pytest.mark.parametrize("name", ["loop", "rings/zigzag"][: count(1, 2)])
def test_a_ring_that_is_the_same_turned_half_round_does_not_and_that_is_said(name: str) -> None:
    for seed in range(count(1, 5)):
        search, place, _ = lap(load_map(name), seed)
        assert place is None
        assert search.places == 2
        assert search.on(0.0) is None, "it gave up"
        assert search.sentence.endswith(
            "2 places fit what it saw, not surely enough yet; say on the monitor where it stands"
        )


@pytest.mark.slow
def test_a_navigator_that_nothing_tells_its_place_looks_for_it_and_then_plans() -> None:
    world = driving()
    sight = FakeSight(world)
    world.navigator = MissionNavigator(
        TOWN,
        lambda: None,
        lambda: world.odometry,
        "robot",
        Glimpse(sight, sight.newest),  # type: ignore[arg-type]
    )
    goal = world.pose.to_world(np.array((0.3, 0.0)))
    for _ in range(3):
        world.turn(seen=False)
    with pytest.raises(
        PlanError, match="places fit what it saw, not surely enough yet; let it drive on, drive it"
    ):
        world.navigator.plan((float(goal[0]), float(goal[1])))
    path = route(TOWN, np.random.default_rng(5))
    world.pose = Pose(*path.points_m[0], float(path.headings_rad[0]))
    for k in range(len(path.arc_m) - 1):
        ends = np.column_stack((path.points_m, path.headings_rad))[[k, k + 1]]
        step = between(ends[:1], ends[1:])[0]
        world.turn(float(step[0]), float(step[2]), seen=False)
        if world.navigator.pose is not None:
            break
    assert world.navigator.pose is not None
    assert math.dist(world.navigator.pose[:2], world.pose[:2]) < 0.15


@pytest.mark.slow
def test_meanwhile_the_way_on_lies_mostly_as_the_road_that_is_seen() -> None:
    """On each of the drives it differs, by as little as how a processor rounds."""
    drives = count(1, 3)
    good = [fits for seed in range(drives) for fits in way_fits(np.random.default_rng(seed))]
    assert len(good) > 80 * drives
    assert np.mean(good) > 0.65


def way_fits(rng: np.random.Generator) -> List[bool]:
    """Of the pictures outside junctions, but the first twenty: whether the way on lies so."""
    view, path = LaneView(TOWN), route(TOWN, rng)
    search, good = Whereabouts(LaneGraph(TOWN), view), []
    search.move(0.0, 0.0, 0.0)
    assert search.on(0.0) is None, "nothing was seen"
    for k, step in enumerate(steps_along(path)):
        now_s, truth = 0.1 * (k + 1), step.pose
        search.move(step.forward_m, step.turn_rad, now_s)
        search.see(look(view, truth, rng), now_s)
        way, road = search.on(now_s), view.at(*truth)
        if way is None:
            break  # three junctions
        assert road is not None
        if road.in_junction:
            continue  # two roads cross there
        turned = wrap_angle(way.pose.heading_rad - way.at.heading_rad) - road.heading_rad
        good.append(bool(abs(way.at.offset_m - road.offset_m) < 0.06 and abs(turned) < 0.35))
        later = search.on(now_s + 1.5)
        assert later is not None
        assert not later.seen, "old pictures tell nothing"
    return good[20:]


@pytest.mark.slow
def test_who_crossed_three_junctions_in_vain_gives_up_before_the_fourth_and_says_so() -> None:
    rng, streets = np.random.default_rng(3), load_map("terraces")  # the same turned half round
    graph, view = LaneGraph(streets), LaneView(streets)
    control = graph.lanes[0].control_points_m
    began = Pose(*control[0], math.atan2(*(control[1] - control[0])[::-1]))
    search, crossed, inside = Whereabouts(graph, view), 0, False
    search.move(0.0, 0.0, 0.0)
    for k, (truth, forward_m, turn_rad) in enumerate(steps_along(path_on(graph, began, 14.0))):
        now_s = 0.1 * (k + 1)
        search.move(forward_m, turn_rad, now_s)
        assert search.see(look(view, truth, rng), now_s) == ()
        road = view.at(*truth)
        assert road is not None
        crossed += inside and not road.in_junction
        inside = road.in_junction
        if search.on(now_s) is None:
            break
        assert "let it drive on" in search.sentence
    assert crossed == search.junctions == 3
    assert 0.1 < road.line_m < 0.4, "its nose is before the line"
    assert "let it drive on" not in search.sentence
    assert "drive it by hand" in search.sentence


def test_the_way_on_is_by_a_place_whose_lane_lies_as_the_one_that_is_seen() -> None:
    """Where it goes on by another one; over a junction it does not, while pictures fit."""
    rng, view = np.random.default_rng(4), LaneView(TOWN)
    path = route(TOWN, np.random.default_rng(7))
    search, before = Whereabouts(LaneGraph(TOWN), view), None
    changes, left, inside, crosses = 0, 0, 0, False
    search.move(0.0, 0.0, 0.0)
    for k, step in enumerate(steps_along(path)):
        now_s = 0.1 * (k + 1)
        x_m, y_m = step.pose.to_world(np.array((0.0, 0.06))).tolist()
        seen = look(view, Pose(x_m, y_m, step.pose.heading_rad), rng)  # left of its lane
        search.move(step.forward_m, step.turn_rad, now_s)
        search.see(seen, now_s)
        way = search.on(now_s)
        if way is None:
            continue
        went_m = math.inf if before is None else math.dist(way.pose[:2], before[:2])
        if went_m > 0.5:
            road = view.at(*way.pose)
            assert road is not None
            assert not road.in_junction
            assert abs(road.offset_m - seen.figures[0, 0]) < 0.08, "the picture corrected it, too"
            assert abs(road.heading_rad - seen.figures[0, 1]) < 0.5
            changes += 1
            left += crosses
        road = view.at(*way.pose)
        crosses, before = road is not None and road.in_junction, way.pose
        inside += crosses
    assert changes > 5
    assert left < 0.04 * inside


@pytest.mark.parametrize(
    ("cross", "left", "tee", "turned_deg"),
    [(0.9, 0.0, 0.0, 0.0), (0.5, 0.0, 0.4, -90.0), (0.85, 0.0, 0.05, 0.0), (0.5, 0.3, 0.15, 0.0)],
)
def test_before_what_may_rather_be_a_t_it_turns_right(
    cross: float, left: float, tee: float, turned_deg: float
) -> None:
    """In most of five searches: in one or the other the likeliest place is not before a cross."""
    turned = [turned_at_the_crossing(seed, (0.0, cross, left, 0.05, tee)) for seed in range(5)]
    assert np.median(turned) == pytest.approx(turned_deg, abs=25.0)


def turned_at_the_crossing(seed: int, junction: tuple[float, ...]) -> float:
    """By how many degrees the way on turns there that a search chooses."""
    rng, view = np.random.default_rng(seed), LaneView(TOWN)
    search = Whereabouts(LaneGraph(TOWN), view)
    search.move(0.0, 0.0, 0.0)
    for k in range(45):  # to the crossing from the south
        now_s, truth = 0.1 * (k + 1), Pose(3.7 * 0.585, 1.95 + 0.02 * k, 0.5 * math.pi)
        road = view.at(*truth)
        assert road is not None
        search.move(0.02, 0.0, now_s)
        seen = look(view, truth, rng)
        if road.line_m < 0.6:
            seen.junction[0] = junction
        search.see(seen, now_s)
        if road.line_m < 0.15:
            break
    way = search.on(now_s)
    assert way is not None
    beyond = way.path.pose_at(way.at.arc_m + 0.7)  # a tile is 0.585 m
    return math.degrees(float(wrap_angle(beyond.heading_rad - way.pose.heading_rad)))


def test_a_navigator_drives_on_while_it_looks_and_only_then() -> None:
    world = driving()
    assert not world.navigator.searches, "without sight"
    sight = FakeSight(world)
    glimpse = Glimpse(sight, sight.newest)  # type: ignore[arg-type]
    told = lambda: None, lambda: world.odometry
    world.navigator = MissionNavigator(TOWN, *told, "robot", glimpse)
    for _ in range(3):
        guidance = world.turn(seen=False)
    assert world.navigator.searches
    assert guidance.path is not None
    assert guidance.pose_within == (0.0, 0.0)
    world.navigator.put(world.pose)
    assert world.navigator.searches, "a person's word is not sure enough"
    assert world.turn(seen=False).path is not None
    for _ in range(300):
        assert guidance.path is not None
        guidance = world.follow(guidance.path, seen=False)
        if guidance.path is None:
            break
    assert not world.navigator.searches, "now it knows its place and its wheels"
    assert guidance.pose_within is not None
    assert guidance.pose_within[0] <= 0.05


def test_a_mission_that_ends_while_it_drives_is_no_leave_to_drive_on() -> None:
    world, bench = seeing(), Bench()
    assert world.turn(seen=False).path is not None, "on its mission"
    bench.drive()
    world.navigator.on_tick(bench.runtime.step())
    world.navigator.end("failed", "no more")
    assert not world.navigator.searches
    assert world.turn(seen=False).path is None, "so it stops"
    bench.runtime.ask(Command.STOP)
    world.navigator.on_tick(bench.runtime.step())
    assert world.navigator.searches, "a person may let it drive on"
    assert world.turn(seen=False).path is not None


def believing(
    within: Tuple[float, float] = (0.05, 0.3), scale: float = 0.02, far: float = math.nan
) -> Finding:
    """In the middle of a lane, as sure of its place and wheels; pictures tell so far from it."""
    fusion = SimpleNamespace(
        poses=np.zeros((1, 3)),
        certainty=np.array([within]),
        scale_deviations=np.array([scale]),
        config=SimpleNamespace(gate=16.3),
    )
    view = SimpleNamespace(at=lambda *_: SimpleNamespace(in_junction=False))
    fix = SimpleNamespace(fusion=fusion, views=[view], see=lambda *_: np.array([far]))
    return Finding(LaneGraph(TOWN), fix)  # type: ignore[arg-type]


def test_how_sure_of_place_and_wheels_it_must_be() -> None:
    assert believing().sure
    assert not believing(within=(0.051, 0.3)).sure
    assert not believing(within=(0.05, 0.301)).sure
    assert not believing(scale=0.0201).sure
    nowhere = believing()
    nowhere._fix.fusion.poses[:] = math.nan
    assert not nowhere.sure


@pytest.mark.parametrize(("far", "pictures"), [(math.nan, 9), (1e9, 3), (4.4, 1000)])
def test_how_many_pictures_make_a_place_strange(far: float, pictures: int) -> None:
    """No road counts 8, a wild picture 16.3 at most; honest ones never do."""
    finding = believing(far=far)
    for k in range(1, 100):
        finding.see(None, 0.1 * k)  # type: ignore[arg-type]
        assert (finding.strange > 6.0) is (k >= pictures)
    finding._fix.views[0].at = lambda *_: SimpleNamespace(in_junction=True)  # type: ignore
    before, finding.strange = finding.strange, 0.0
    finding.see(None, 10.0)  # type: ignore[arg-type]
    assert (finding.strange, before > 0.0) == (0.0, True), "of junctions nothing is told"


@pytest.mark.parametrize("forward_m", [0.1, -0.1])
def test_after_fifteen_metres_it_gives_up(forward_m: float) -> None:
    search = Whereabouts(GRAPH, LaneView(TOWN))
    for k in range(152):
        assert ("let it drive on" in search.sentence) is (k <= 150)
        search.move(forward_m, 0.0, 0.1 * k)


AHEAD = LaneAhead(0.02, 0.1, 0.0, 0.0, 1.0, 0.0, 0.3, 2, False)  # a left one behind its line


def told_of(road: Optional[LaneAhead], line: float = 0.9, **errors: float) -> float:
    """How likely a picture is that is so far off what the map shows, 5 cm sure along the lane."""
    names = ("offset_m", "heading_rad", "curvature_pm", "line_m")
    figures = [getattr(AHEAD, name) + errors.get(name, 0.0) for name in names]
    kinds = np.array((0.1, 0.05, 0.8, 0.0, 0.05))
    parts = (figures, np.array((0.01, 0.05, 0.5, 0.02)), line, 0.97, kinds, 0.0)
    return _likely(Seen(*(np.asarray(part)[None] for part in parts)), road, 0.05)


def test_a_picture_is_as_likely_as_what_the_map_shows_there() -> None:
    best = math.log(0.9) + math.log(0.8)
    assert told_of(AHEAD) == pytest.approx(best)
    assert told_of(None) == -4.0
    assert told_of(AHEAD, line=0.0) == pytest.approx(math.log(0.03) + math.log(0.8))
    other = AHEAD._replace(kind=3)  # of which it says that it is none
    assert told_of(other) == pytest.approx(math.log(0.9) + math.log(0.03))
    far = AHEAD._replace(line_m=math.inf)
    assert told_of(far) == pytest.approx(math.log(0.1) + math.log(0.1))
    assert told_of(far._replace(in_junction=True)) == pytest.approx(math.log(0.1))
    for name, variance, share in (
        ("offset_m", 4 * 0.01**2 + 0.05**2, 1.0),
        ("heading_rad", 4 * 0.05**2 + 0.2**2, 1.0),
        ("curvature_pm", 0.5**2 + 0.5**2, 1.0),
        ("line_m", 0.05**2 + 4 * 0.02**2, 0.9),
    ):
        for deviations, cost in ((1.0, 0.5), (-2.0, 2.0), (9.0, 4.5)):
            off = told_of(AHEAD, **{name: deviations * math.sqrt(variance)})
            assert off == pytest.approx(best - share * cost)
    bent = AHEAD._replace(curvature_pm=math.nan)
    assert told_of(bent) == pytest.approx(best - 0.5), "before a junction"


def left_over(
    rival: float = 0.0, driven_m: float = 0.51, sd_m: float = 0.03, apart_m: float = 2.0
) -> Tuple[Whereabouts, Tuple[Place, ...]]:
    """Of a place, and a rival so far from it with such a share of its weight."""
    search = Whereabouts(GRAPH, LaneView(TOWN))
    poses = np.tile((9.0, 9.0, 0.0), (len(search._weights), 1))
    poses[:2] = (1.0, 1.0, 0.5), (1.0 + apart_m, 1.0, 0.5)
    search._weights[:] = -99.0
    search._weights[:2] = 0.0, math.log(rival) if rival else -99.0
    search.move(driven_m, 0.0, 0.1)
    search._fusion.put(np.arange(len(poses)), poses, (sd_m, sd_m, 0.05))
    return search, search._left()


def test_a_place_is_told_once_it_is_sure_and_near_enough_and_something_was_driven() -> None:
    search, ((pose, deviations),) = left_over()
    assert pose == pytest.approx((1.0, 1.0, 0.5))
    assert deviations == pytest.approx((1.224 * 0.03, 1.224 * 0.03, 0.98 * 0.05), rel=1e-3)
    assert search.places == 1
    assert left_over(rival=0.004)[1]
    search, told = left_over(rival=0.006)
    assert (told, search.places, search._alive.sum()) == ((), 1, 2)
    assert left_over(rival=0.06)[0].places == 2
    assert left_over(driven_m=0.49)[1] == ()
    assert left_over(sd_m=0.048)[1]
    assert left_over(sd_m=0.05)[1] == ()  # 95 % lie within 12.2 cm
    search, told = left_over(rival=0.9, apart_m=0.2)  # the same place
    assert (len(told), search.places, search._alive.sum()) == (1, 1, 2)
    search, told = left_over(rival=0.9, apart_m=0.04)
    assert (len(told), search.places, search._alive.sum()) == (1, 1, 1), "it is there twice"
