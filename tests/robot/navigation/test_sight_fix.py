"""A robot whose overhead poses end after its start finds its way by what it sees of the lane."""

from __future__ import annotations

import math
from typing import List, Optional, Sequence

import numpy as np
import pytest

from robot.camera.source import Frame
from robot.contract import ImageSpec
from robot.errors import PlanError
from robot.geometry import Pose, between, radius_95
from robot.navigation.fusion import FusionConfig, PoseFusion
from robot.navigation.lane_view import LaneView
from robot.navigation.navigator import Glimpse, MissionNavigator
from robot.navigation.planner import LaneGraph, path_on
from robot.navigation.road_map import Lane, load_map
from robot.navigation.sight_fix import SightFix
from robot.vision.sight import Seen, SightContract
from tests.robot.navigation.test_navigator import GOAL, TOWN, World, driving

SLIP = 1.06  # wheels larger than their steps say
LIMIT_M, LIMIT_RAD = 0.08, 0.35


class FakeSight:
    """Sees the lane where the robot truly is, or nothing."""

    contract = SightContract(ImageSpec(80, 60, 20))

    def __init__(self, world: World) -> None:
        self.world, self.view, self.blind = world, LaneView(TOWN), False

    def __call__(self, pictures: np.ndarray) -> Seen:
        road = None if self.blind else self.view.at(*self.world.pose)
        figures, line, sure = np.zeros((1, 4)), np.zeros(1), np.zeros(1)
        junction = np.zeros((1, 5))
        if road is not None:
            line_m = road.line_m if 0.12 < road.line_m < 0.45 else math.nan
            curvature_pm = np.nan_to_num(road.curvature_pm)
            figures[0] = road.offset_m, road.heading_rad, curvature_pm, np.nan_to_num(line_m)
            line[0], sure[0] = math.isfinite(line_m), 1.0
            junction[0, road.kind if road.line_m < 0.6 else 0] = 1.0
        deviations = np.array([[0.01, 0.05, 0.5, 0.02]])
        return Seen(figures, deviations, line, sure, junction, np.zeros(1))

    def newest(self) -> Optional[Frame]:
        number = round(self.world.now_s / 0.1)
        return Frame(np.zeros((120, 160, 3), np.uint8), number, self.world.now_s)


def seeing() -> World:
    """A robot on its mission, with sight, whose wheels slip."""
    world = driving()
    sight = FakeSight(world)
    receive, odometry = world.navigator._receive, world.navigator._odometry  # as they are wired
    glimpse = Glimpse(sight, sight.newest)  # type: ignore[arg-type]
    world.navigator = MissionNavigator(TOWN, receive, odometry, "robot", glimpse)
    world.sight = sight  # type: ignore[attr-defined]
    for _ in range(5):
        world.turn()
    world.navigator.begin("mission-1", GOAL)
    world.turn()
    return world


def apart_m(world: World) -> float:
    believed = world.guidance.pose
    assert believed is not None
    return math.hypot(believed.x_m - world.pose.x_m, believed.y_m - world.pose.y_m)


def drive(world: World, decisions: int) -> None:
    for _ in range(decisions):
        assert world.guidance.path is not None
        before = world.odometry
        world.follow(world.guidance.path, seen=False)
        step_m = math.hypot(world.odometry.x_m - before.x_m, world.odometry.y_m - before.y_m)
        world.pose = world.pose.moved((SLIP - 1.0) * step_m, 0.0)
        assert not world.guidance.pose_jump
        if world.guidance.arrived:
            return


@pytest.mark.slow
def test_it_arrives_without_an_overhead_pose_after_the_start() -> None:
    world = seeing()
    drive(world, 400)
    assert world.guidance.arrived
    assert apart_m(world) < 0.06


def test_without_sight_it_loses_its_way() -> None:
    world = driving()
    drive(world, 200)
    assert apart_m(world) > 0.15


def test_it_is_sure_while_it_sees_and_unsure_soon_after() -> None:
    world = seeing()
    drive(world, 20)
    within = world.guidance.pose_within
    assert within is not None
    assert within[0] < LIMIT_M
    assert within[1] < LIMIT_RAD
    world.sight.blind = True  # type: ignore[attr-defined]
    driven = 0
    while world.guidance.pose_within[0] < LIMIT_M:  # type: ignore[index]
        world.turn(0.03, 0.0, seen=False)
        driven += 1
        assert driven < 60, "it must not believe in its wheels for ever"
    assert driven > 3


def until_strange(world: World, decisions: int, told: bool = False) -> int:
    """How many decisions pass until it says so, straight on; at most these."""
    for k in range(decisions):
        if world.turn(0.02, seen=told).pose_jump:
            return k
    return decisions


def on_its_way() -> World:
    """A second after the last overhead pose."""
    world = seeing()
    drive(world, 12)
    return world


@pytest.mark.parametrize("by_rad", [-2.2, 2.2])
def test_who_is_turned_round_finds_the_lane_strange_within_a_second(by_rad: float) -> None:
    world = on_its_way()
    world.pose = world.pose.moved(0.0, by_rad)
    assert until_strange(world, 30) < 10


def test_who_sees_no_road_where_the_map_has_a_lane_finds_that_strange_after_a_second() -> None:
    world = on_its_way()
    world.sight.blind = True  # type: ignore[attr-defined]
    assert 5 < until_strange(world, 30) <= 12


def test_pictures_are_not_asked_while_the_localizer_tells_the_place() -> None:
    world = on_its_way()
    world.sight.blind = True  # type: ignore[attr-defined]
    assert until_strange(world, 30, told=True) == 30


def test_a_person_who_says_where_it_stands_ends_the_doubt() -> None:
    world = on_its_way()
    world.pose = world.pose.moved(0.0, math.pi)
    assert until_strange(world, 30) < 30
    world.pose = world.pose.moved(0.0, math.pi)
    world.navigator.put(world.pose)
    assert until_strange(world, 3) == 3


@pytest.mark.parametrize("narrow", [0.0, 0.2, 0.5, 0.7, 0.9, 1.0])
def test_the_circle_of_certainty_holds_95_of_100(narrow: float) -> None:
    axes = np.array([[math.cos(0.7), -math.sin(0.7)], [math.sin(0.7), math.cos(0.7)]])
    spread = 0.04 * np.array([1.0, narrow])
    covariance = axes @ np.diag(spread**2) @ axes.T
    errors = np.random.default_rng(0).standard_normal((200_000, 2)) * spread @ axes.T
    inside = np.hypot(*errors.T) <= radius_95(covariance[None])[0]
    assert inside.mean() == pytest.approx(0.95, abs=0.003)


@pytest.mark.slow
def test_who_arrived_keeps_what_it_learned_of_its_wheels_and_who_was_stopped_does_not() -> None:
    world = seeing()
    drive(world, 400)
    assert world.guidance.arrived
    learned = float(world.navigator._fusion._state[0, 3])
    assert learned > 0.02, "these wheels slip by 6 %"
    world.navigator.begin("mission-2", GOAL)
    assert world.navigator._fusion._state[0, 3] == learned
    world.navigator.end("stopped")
    world.navigator.begin("mission-3", GOAL)
    assert world.navigator._fusion._state[0, 3] == 0.0


def test_who_is_put_somewhere_learns_its_wheels_anew() -> None:
    world = seeing()
    for put, kept in ((False, 0.03), (True, 0.0)):
        world.navigator.end("stopped")
        world.navigator._finding.learned = True  # type: ignore[union-attr]
        if put:
            world.navigator.put(world.pose)
        world.navigator._fusion._state[0, 3] = 0.03  # as by hand, since then
        world.navigator.begin("mission-2", GOAL)
        assert world.navigator._fusion._state[0, 3] == kept


def test_who_is_put_somewhere_or_sent_somewhere_begins_anew(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Jumps and doubts of before, and detours of another mission, do not count."""
    forgotten: List[int] = []
    world = seeing()
    monkeypatch.setattr(world.navigator._way, "reset", lambda: forgotten.append(1))
    world.navigator._jumps, world.navigator._detours = 5, 3
    assert world.turn(seen=False).pose_jump
    world.navigator.put(world.pose)
    within = world.navigator._fusion.certainty[0]
    assert within == pytest.approx((0.122, math.radians(19.6)), abs=0.005), "10 cm, 20 degrees"
    assert (len(forgotten), world.turn(seen=False).pose_jump) == (1, False)
    world.navigator.begin("mission-2", GOAL)
    assert (len(forgotten), world.navigator._detours) == (2, 0)


def test_how_a_mission_ended_is_not_told_anew() -> None:
    world = seeing()
    world.navigator.end("failed", "too late")
    world.navigator.end("stopped", "by a person")
    status = world.navigator.status
    assert status is not None
    assert (status.phase, status.reason) == ("failed", "too late")


def test_the_place_is_told_by_the_localizer_by_sight_or_by_the_wheels_alone() -> None:
    """Each for a second after it last said something."""
    world, told = seeing(), []
    for decision in range(30):
        world.sight.blind = decision >= 15  # type: ignore[attr-defined]
        world.turn(0.02 if decision < 15 else 0.0, seen=False)
        belief = world.navigator.belief(world.now_s)
        told.append(belief.source if belief is not None else "nobody")
    assert told[5] == "overhead"
    assert (told[12], told[20]) == ("sight", "sight")
    assert told[28] == "wheels"


@pytest.mark.slow
def test_a_person_tells_where_it_stands_and_it_drives_from_there() -> None:
    world = driving()
    sight = FakeSight(world)
    navigator = MissionNavigator(
        TOWN,
        lambda: None,
        lambda: world.odometry,
        "robot",
        Glimpse(sight, sight.newest),  # type: ignore[arg-type]
    )
    truth, world.navigator = world.pose, navigator
    assert navigator.belief(0.0) is None
    told = Pose(truth.x_m + 0.06, truth.y_m - 0.05, truth.heading_rad + 0.25)
    navigator.put(told)
    assert navigator.pose == pytest.approx(told)
    assert navigator.belief(world.now_s).source == "wheels"  # type: ignore[union-attr]
    for _ in range(5):
        world.turn(seen=False)
    belief = navigator.belief(world.now_s)
    assert belief is not None
    assert belief.source == "sight"
    assert belief.short_m < 0.05 <= belief.long_m, "a straight road says nothing of the way along"
    navigator.begin("mission-1", GOAL)
    world.turn(seen=False)
    drive(world, 400)
    assert world.guidance.arrived
    assert apart_m(world) < 0.06


def test_where_it_stands_is_told_only_of_a_robot_with_sight_that_stands_on_the_road() -> None:
    with pytest.raises(PlanError, match="robot with sight"):
        driving().navigator.put(Pose(0.5, 0.5, 0.0))
    world = seeing()
    grass = next(t for row in TOWN.tiles for t in row if not t.is_road)
    beside = Pose((grass.column + 0.5) * 0.585, (TOWN.rows - grass.row - 0.5) * 0.585, 0.0)
    for place in (Pose(-0.2, 0.5, 0.0), beside):
        with pytest.raises(PlanError, match="on the road"):
            world.navigator.put(place)
    world.navigator._driving = True
    before = world.navigator.pose
    with pytest.raises(PlanError, match="it drives"):
        world.navigator.put(world.pose)
    assert world.navigator.pose == before


def test_who_stands_where_no_lane_is_seen_but_knows_its_place_may_begin_a_mission() -> None:
    world = seeing()
    world.navigator.end("stopped")
    world.sight.blind = True  # type: ignore[attr-defined]
    for _ in range(15):
        world.turn()
    assert world.navigator.searches  # it does not know its wheels
    place_m, turned_rad = world.guidance.pose_within or (math.inf, math.inf)
    assert 0.0 < place_m < LIMIT_M
    assert 0.0 < turned_rad < LIMIT_RAD


def test_before_the_first_pose_nothing_is_sure() -> None:
    world = driving()
    assert world.guidance.pose_within is None, "nobody asks a robot without sight"
    sight = FakeSight(world)
    lost = MissionNavigator(
        TOWN,
        lambda: None,
        lambda: Pose(0.0, 0.0, 0.0),
        "robot",
        Glimpse(sight, sight.newest),  # type: ignore[arg-type]
    )
    assert lost.look(1.0).pose_within == (math.inf, math.inf)


def test_a_steady_error_of_sight_becomes_a_state_and_not_a_pose() -> None:
    road_map = load_map("loop")
    config = FusionConfig(sight=True, position_m=0.004)  # overhead poses are much better
    view, fusion = LaneView(road_map), PoseFusion(1, config)
    lane = road_map.lanes[0].control_points_m
    heading_rad = math.atan2(*(lane[3] - lane[0])[::-1])
    truth = Pose(*lane[0], heading_rad)
    fusion.move(np.zeros(1), np.zeros(1), 0.0)
    fusion.measure(np.array([truth]), np.zeros(1))
    fix, rng = SightFix(fusion, [view]), np.random.default_rng(0)
    for k in range(1, 60):
        now_s, rolled_m = 0.1 * k, 0.02 if k % 2 else -0.02
        truth = truth.moved(rolled_m, 0.0)  # who stands sees the same picture again and again
        fusion.move(np.full(1, rolled_m), np.zeros(1), now_s)
        told = np.array([truth]) + rng.normal(0.0, (0.004, 0.004, 0.05))
        fusion.measure(told, np.array([now_s]))
        road = view.at(*truth)
        assert road is not None
        figures = np.array([[road.offset_m + 0.02, road.heading_rad, 0.0, 0.0]])
        seen = Seen(
            figures,
            np.array([[0.01, 0.05, 9.0, 0.1]]),
            *np.zeros((2, 1)),
            np.zeros((1, 5)),
            np.zeros(1),
        )
        fix.see(seen._replace(road=np.ones(1)), np.ones(1, dtype=bool), now_s)
    assert fusion.seen_error()[0, 0] > 0.012
    assert np.hypot(*(fusion.poses[0, :2] - truth[:2])) < 0.008


def test_who_stands_grows_no_surer_by_seeing_the_same_again() -> None:
    """One picture's error is every picture's there: of 24 standing robots 38 % were outside."""
    road_map = load_map("loop")
    view, fusion = LaneView(road_map), PoseFusion(1, FusionConfig(sight=True))
    lane = road_map.lanes[0].control_points_m
    truth = Pose(*lane[0], math.atan2(*(lane[3] - lane[0])[::-1]))
    road = view.at(*truth)
    assert road is not None
    fusion.move(np.zeros(1), np.zeros(1), 0.0)
    fusion.measure(np.array([truth]), np.zeros(1))
    fix = SightFix(fusion, [view])
    figures = np.array([[road.offset_m + 0.03, road.heading_rad + 0.1, 0.0, 0.0]])
    deviations = np.array([[0.02, 0.1, 9.0, 0.1]])
    seen = Seen(figures, deviations, *np.zeros((2, 1)), np.zeros((1, 5)), np.zeros(1))
    within_m, off_m = [], []
    for k in range(1, 601):
        fusion.move(np.zeros(1), np.zeros(1), 0.1 * k)
        fix.see(seen._replace(road=np.ones(1)), np.ones(1, dtype=bool), 0.1 * k)
        within_m.append(float(fusion.certainty[0, 0]))
        off_m.append(float(np.hypot(*(fusion.poses[0, :2] - truth[:2]))))
        assert fix.took_s[0] == 0.1 * k, "what it sees still tells that it is there"
    assert within_m[5] < within_m[0], "a picture or a few tell it something"
    assert within_m[-1] == pytest.approx(within_m[10], rel=0.05)
    assert off_m[-1] < within_m[-1]
    for k in range(4):  # on another place it sees something new
        fusion.move(np.full(1, 0.02), np.zeros(1), 60.1 + 0.1 * k)
        fix.see(seen._replace(road=np.ones(1)), np.ones(1, dtype=bool), 60.1 + 0.1 * k)
    assert float(fusion.certainty[0, 0]) < 0.99 * within_m[-1]


def test_a_steady_error_of_the_red_lines_distance_becomes_a_state_too() -> None:
    """As of a camera that looks up a little: each line seems a tenth farther than it is."""
    view, fusion = LaneView(TOWN), PoseFusion(1, FusionConfig(sight=True, position_m=0.004))
    rng, poses = np.random.default_rng(0), (lane_pose(lane) for lane in TOWN.lanes)
    truth = next(pose for pose in poses if near(view, pose))
    fusion.move(np.zeros(1), np.zeros(1), 0.0)
    fusion.measure(np.array([truth]), np.zeros(1))
    fix, road = SightFix(fusion, [view]), view.at(*truth)
    assert road is not None
    figures = np.array([[road.offset_m, road.heading_rad, 0.0, 1.1 * road.line_m]])
    deviations = np.array([[0.01, 0.05, 9.0, 0.02]])
    seen = Seen(figures, deviations, np.ones(1), np.ones(1), np.zeros((1, 5)), np.zeros(1))
    for k in range(1, 60):
        fusion.move(np.zeros(1), np.zeros(1), 0.1 * k)
        told = np.array([truth]) + rng.normal(0.0, (0.004, 0.004, 0.05))
        fusion.measure(told, np.array([0.1 * k]))
        fix.see(seen, np.ones(1, dtype=bool), 0.1 * k)
    assert 0.05 < fusion.seen_error()[0, 2] < 0.12
    assert np.hypot(*(fusion.poses[0, :2] - truth[:2])) < 0.008


def test_who_stands_grows_no_surer_by_the_same_red_line() -> None:
    view, fusion = LaneView(TOWN), PoseFusion(1, FusionConfig(sight=True))
    truth = next(pose for pose in map(lane_pose, TOWN.lanes) if near(view, pose))
    fusion.move(np.zeros(1), np.zeros(1), 0.0)
    fusion.put(np.arange(1), np.array([truth]), (0.05, 0.05, 0.1))
    fix, road, within_m = SightFix(fusion, [view]), view.at(*truth), []
    assert road is not None
    figures = np.array([[road.offset_m, road.heading_rad, 0.0, road.line_m]])
    deviations = np.array([[0.01, 0.05, 9.0, 0.03]])
    seen = Seen(figures, deviations, np.ones(1), np.ones(1), np.zeros((1, 5)), np.zeros(1))
    for k in range(1, 60):
        fusion.move(np.zeros(1), np.zeros(1), 0.1 * k)
        fix.see(seen, np.ones(1, dtype=bool), 0.1 * k)
        within_m.append(float(fusion.certainty[0, 0]))
    assert within_m[-1] == pytest.approx(within_m[10], rel=0.02)


def test_a_picture_shows_what_was_before_the_robot_fifty_milliseconds_ago() -> None:
    view, fusion = LaneView(load_map("loop")), PoseFusion(1, FusionConfig(sight=True))
    truth, fix = lane_pose(view.road_map.lanes[0]), SightFix(fusion, [view])
    fusion.move(np.zeros(1), np.zeros(1), 0.0)
    fusion.put(np.arange(1), np.array([truth]), (0.01, 0.01, 0.1))
    fusion.move(np.full(1, 0.03), np.full(1, 0.24), 0.1)
    then = view.at(*truth.moved(0.015, 0.12))
    assert then is not None
    figures = np.array([[then.offset_m, then.heading_rad, then.curvature_pm, 0.0]])
    deviations = np.array([[0.01, 0.05, 9.0, 0.1]])
    seen = Seen(figures, deviations, np.zeros(1), np.ones(1), np.zeros((1, 5)), np.zeros(1))
    fix.see(seen, np.ones(1, dtype=bool), 0.1)
    assert fusion.poses[0] == pytest.approx(truth.moved(0.03, 0.24), abs=2e-3)


def corrected(
    view: LaneView, truth: Pose, figures: Sequence[float], line: float = 0.0, turn_rad: float = 0.0
) -> Pose:
    """Where it believes to be after one picture, that was there to 5 cm and 0.1 rad."""
    fusion = PoseFusion(1, FusionConfig(sight=True))
    fusion.move(np.zeros(1), np.zeros(1), 0.0)
    fusion.put(np.arange(1), np.array([truth]), (0.05, 0.05, 0.1))
    fusion.move(np.zeros(1), np.full(1, turn_rad), 0.1)
    deviations = np.array([[0.01, 0.02, 9.0, 0.01]])
    told = np.full(1, line), np.ones(1), np.zeros((1, 5)), np.zeros(1)
    seen = Seen(np.array([figures]), deviations, *told)
    SightFix(fusion, [view]).see(seen, np.ones(1, dtype=bool), 0.1)
    return Pose(*fusion.poses[0].tolist())


@pytest.mark.parametrize(("seen_m", "counts"), [(0.09, False), (0.11, True)])
def test_a_red_line_nearer_than_ten_centimetres_has_left_the_picture(
    seen_m: float, counts: bool
) -> None:
    view = LaneView(TOWN)
    begin = next(pose for pose in map(lane_pose, TOWN.lanes) if near(view, pose))
    road = view.at(*begin)
    assert road is not None
    truth = begin.moved(road.line_m - 0.08, 0.0)
    road = view.at(*truth)
    assert road is not None
    figures = road.offset_m, road.heading_rad, 0.0, seen_m
    with_line, without = (corrected(view, truth, figures, line) for line in (1.0, 0.0))
    assert (math.dist(with_line[:2], without[:2]) > 0.005) is counts


@pytest.mark.parametrize(("askew_rad", "counts"), [(0.5, True), (0.7, False)])
def test_who_is_askew_in_a_junction_may_mean_another_lane(askew_rad: float, counts: bool) -> None:
    view = LaneView(TOWN)
    within = (lane for lane in TOWN.lanes if lane.tile.is_junction)
    poses = (Pose(*lane_pose(lane)[:2], lane_pose(lane).heading_rad + askew_rad) for lane in within)
    truth = next(p for p in poses if (r := view.at(*p)) and abs(r.heading_rad - askew_rad) < 0.01)
    road = view.at(*truth)
    assert road is not None
    assert road.in_junction
    found = corrected(view, truth, (road.offset_m + 0.03, road.heading_rad, 0.0, 0.0))
    assert (math.dist(found[:2], truth[:2]) > 0.005) is counts


def test_a_heading_seen_while_it_turned_counts_less() -> None:
    view = LaneView(load_map("loop"))
    truth, off_rad = lane_pose(view.road_map.lanes[0]), []
    for turn_rad in (0.0, 0.4):
        then = view.at(*truth.moved(0.0, 0.5 * turn_rad))
        assert then is not None
        figures = then.offset_m, then.heading_rad + 0.05, then.curvature_pm, 0.0
        found = corrected(view, truth, figures, turn_rad=turn_rad)
        off_rad.append(found.heading_rad - truth.heading_rad - turn_rad)
    assert 0.0 < off_rad[1] < 0.9 * off_rad[0]


def near(view: LaneView, pose: Pose) -> bool:
    road = view.at(*pose)
    return road is not None and not road.in_junction and 0.25 < road.line_m < 0.45


def lane_pose(lane: Lane) -> Pose:
    begins, *_, ends = lane.control_points_m
    return Pose(*begins, math.atan2(*(ends - begins)[::-1])).moved(0.15, 0.0)


@pytest.mark.parametrize(
    ("offset_m", "deviation_m"), [(0.4, 0.01), (0.19, 0.1), (0.23, 0.1), (-0.4, 0.01)]
)
def test_what_cannot_be_and_the_oncoming_lane_is_not_believed(
    offset_m: float, deviation_m: float
) -> None:
    """The oncoming lane not even where sight is unsure: who was turned round sees it as well."""
    view, fusion = LaneView(TOWN), PoseFusion(1, FusionConfig(sight=True))
    world = driving()
    fusion.move(np.zeros(1), np.zeros(1), 0.0)
    fusion.measure(np.array([world.pose]), np.zeros(1))
    before = fusion.poses.copy()
    figures, deviations = np.array([[offset_m, 0.0, 0.0, 0.0]]), np.full((1, 4), deviation_m)
    far = Seen(figures, deviations, *np.zeros((4, 1)))
    fusion.move(np.zeros(1), np.zeros(1), 0.1)
    fix = SightFix(fusion, [view])
    fix.see(far._replace(road=np.ones(1)), np.ones(1, dtype=bool), 0.1)
    np.testing.assert_array_equal(fusion.poses, before)
    assert fix.took_s[0] < 0.0, "it counts as no lane seen"


@pytest.mark.slow
def test_minutes_by_sight_alone_leave_the_covariance_one() -> None:
    """Rounding made it unequal to its transpose, more so with every picture, until it was none."""
    fusion, world = PoseFusion(config=FusionConfig(sight=True)), driving()
    sight, fix = FakeSight(world), SightFix(fusion, [LaneView(TOWN)])
    path = path_on(LaneGraph(TOWN), world.pose, 70.0)
    fusion.put(np.arange(1), np.array([world.pose]), (0.05, 0.05, 0.17))
    arc_m, before = path.project(*world.pose[:2]).arc_m, world.pose
    for k in range(2000):
        arc_m += 0.03
        world.pose = Pose(*path.pose_at(arc_m))
        ((forward_m, _, turn_rad),) = between(np.array([before]), np.array([world.pose]))
        fusion.move(np.array([forward_m]), np.array([turn_rad]), 0.1 * (k + 1))
        fix.see(sight(np.zeros(0)), np.ones(1, dtype=bool), 0.1 * (k + 1))
        before = world.pose
    covariance = fusion._covariance[0]
    assert np.abs(covariance - covariance.T).max() < 1e-12
    assert np.linalg.eigvalsh(covariance)[0] > 0.0
