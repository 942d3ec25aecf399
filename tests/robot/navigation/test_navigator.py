from __future__ import annotations

import dataclasses
import math
from contextlib import suppress
from typing import List, Optional, Tuple

import numpy as np
import pytest

from robot.contract import ACTION_TWISTS, CONTROL_DT_S
from robot.errors import PlanError
from robot.geometry import Pose, wrap_angle
from robot.link.messages import PosesMessage, Sighting
from robot.navigation.lane_view import LaneView
from robot.navigation.navigator import MissionNavigator
from robot.navigation.neighbours import Neighbours
from robot.navigation.path import Path, path_input
from robot.navigation.planner import LaneGraph, plan_path, plan_route
from robot.navigation.road_map import load_map
from robot.navigation.road_watch import RoadWatch
from robot.navigation.way_check import WayCheck
from robot.parts import Guidance
from robot.safety.state_machine import Command
from tests.robot.runtime.test_loop import Bench

TOWN = load_map("town")
GRAPH, VIEW = LaneGraph(TOWN), LaneView(TOWN)
SHORT = 0.585  # [m]
ARRIVAL_M, OFF_PATH_TILES, JUMPS = 0.05, 0.25, 5


class World:
    """A robot that moves as told, its odometry in a frame of its own, and the localizer."""

    def __init__(self, start: Pose) -> None:
        self.now_s = 50.0
        self.pose = start
        self.odometry = Pose(3.0, -2.0, 1.0)
        self.messages: List[PosesMessage] = []
        self.session, self.sequence = "a" * 16, 0
        self.others: Tuple[Sighting, ...] = ()
        self.navigator = MissionNavigator(
            TOWN,
            lambda: self.messages.pop() if self.messages else None,
            lambda: self.odometry,
            "robot",
            watch=RoadWatch(VIEW, Neighbours(VIEW, "robot")),
        )
        self.guidance = Guidance()

    def tell(self, pose: Pose, session: str = "") -> None:
        self.sequence += 1
        heading_rad = float(wrap_angle(pose.heading_rad))
        self.messages = [
            PosesMessage(
                (Sighting("robot", pose.x_m, pose.y_m, heading_rad, 0.9), *self.others),
                *(self.now_s, session or self.session, self.sequence, self.now_s),
            )
        ]

    def turn(self, forward_m: float = 0.0, turn_rad: float = 0.0, seen: bool = True) -> Guidance:
        self.now_s += CONTROL_DT_S
        self.pose = self.pose.moved(forward_m, turn_rad)
        self.odometry = self.odometry.moved(forward_m, turn_rad)
        if seen:
            self.tell(self.pose)
        self.guidance = self.navigator.look(self.now_s)
        return self.guidance

    def follow(self, path_rad: np.ndarray, seen: bool = True) -> Guidance:
        """Drive one decision towards the middle of the path input."""
        wanted = float(path_rad[2]) * math.pi / 4 / 0.14
        best = min(ACTION_TWISTS, key=lambda t: abs(t.turn_radps / t.forward_mps - 2.0 * wanted))
        return self.turn(best.forward_mps * CONTROL_DT_S, best.turn_radps * CONTROL_DT_S, seen=seen)


def route() -> Tuple[Pose, Tuple[float, float]]:
    """From the middle of one lane to a far one."""
    rng = np.random.default_rng(3)
    for _ in range(100):
        lanes = [GRAPH.lanes[i] for i in rng.integers(0, len(GRAPH.lanes), 2)]
        a, b = (np.asarray(lane.control_points_m) for lane in lanes)
        start = Pose(*a[0], math.atan2(*(a[1] - a[0])[::-1]))
        try:
            path = plan_path(GRAPH, start, (float(b[3][0]), float(b[3][1])))
        except PlanError:
            continue
        if path.length_m > 5 * SHORT:
            return path.pose_at(0.0), (float(b[3][0]), float(b[3][1]))
    raise AssertionError("no route")


START, GOAL = route()


def driving() -> World:
    world = World(START)
    for _ in range(3):
        world.turn()
    world.navigator.begin("mission-1", GOAL)
    world.turn()
    return world


def test_without_a_pose_there_is_no_mission() -> None:
    world = World(START)
    guidance = world.turn(seen=False)
    assert guidance.pose is None
    assert guidance.path is None
    assert guidance.pose_age_s == math.inf
    with pytest.raises(PlanError, match="expected an overhead pose"):
        world.navigator.begin("m", GOAL)


def test_a_place_off_the_road_is_refused() -> None:
    world = driving()
    with pytest.raises(PlanError):
        world.navigator.begin("m", (1000.0, 1000.0))


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_robot_that_would_stop_at_once_gets_no_mission(side: float) -> None:
    beside_m = side * (OFF_PATH_TILES * TOWN.tile_size_m + 0.01)
    left = np.array([-math.sin(START.heading_rad), math.cos(START.heading_rad)])
    world = World(
        START._replace(x_m=START.x_m + beside_m * left[0], y_m=START.y_m + beside_m * left[1])
    )
    for _ in range(3):
        world.turn()
    with pytest.raises(PlanError, match=r"beside the nearest one.*put it into a lane"):
        world.navigator.begin("m", GOAL)
    assert world.turn().path is None


def test_the_path_input_is_that_of_the_contract() -> None:
    world = driving()
    path = plan_path(GRAPH, world.pose, GOAL)
    assert world.guidance.path is not None
    np.testing.assert_allclose(world.guidance.path, path_input(path, world.pose), atol=0.05)


@pytest.mark.slow
@pytest.mark.parametrize("every", [1, 5])
def test_it_arrives_also_on_few_poses(every: int) -> None:
    world = driving()
    turns = 0
    while not world.guidance.arrived:
        assert world.guidance.path is not None
        told = world.guidance
        assert not any((told.off_path, told.off_map, told.pose_jump, told.duplicate_publisher))
        assert not told.pose_doubt
        assert not told.not_moving
        world.follow(world.guidance.path, seen=turns % every == 0)
        turns += 1
        assert turns < 600
        believed = world.navigator.pose
        assert believed is not None
        assert math.hypot(believed.x_m - world.pose.x_m, believed.y_m - world.pose.y_m) < 0.03
    assert math.hypot(world.pose.x_m - GOAL[0], world.pose.y_m - GOAL[1]) < ARRIVAL_M + 0.05
    status = world.navigator.status
    assert status is not None
    assert (status.phase, status.id) == ("arrived", "mission-1")
    assert status.progress > 0.95


def test_leaving_the_path_is_noticed() -> None:
    world = driving()
    world.turn(0.0, math.pi / 2)
    turns = 0
    while not world.guidance.off_path:
        world.turn(0.02)
        turns += 1
        assert turns < 40
    assert turns * 0.02 >= OFF_PATH_TILES * TOWN.tile_size_m - 0.05


def test_turning_round_is_noticed() -> None:
    world = driving()
    for _ in range(8):
        world.turn(0.0, math.pi / 8)
    assert world.guidance.off_path


def test_poses_that_stay_away_grow_old_and_steps_carry_on() -> None:
    world = driving()
    for _ in range(8):
        assert world.guidance.path is not None
        world.follow(world.guidance.path, seen=False)
    assert world.guidance.pose_age_s == pytest.approx(0.8, abs=0.15)
    assert world.guidance.pose is not None
    assert world.guidance.pose.x_m == pytest.approx(world.pose.x_m, abs=0.02)


def late(world: World, delay_s: float) -> Guidance:
    """A turn of a standing robot, with a pose whose picture is so old."""
    world.sequence += 1
    sent_s = world.now_s + CONTROL_DT_S
    stamp = (sent_s - delay_s, world.session, world.sequence, sent_s)
    world.messages = [PosesMessage((Sighting("robot", *world.pose, 0.9),), *stamp)]
    return world.turn(seen=False)


def test_age_counts_from_the_last_arrival_where_the_delay_is_usual() -> None:
    world = driving()
    for _ in range(4):
        guidance = late(world, 0.2)
    assert guidance.pose_age_s == pytest.approx(0.0, abs=1e-6)
    ages_s = [world.turn(seen=False).pose_age_s for _ in range(10)]
    assert ages_s == pytest.approx(np.arange(1, 11) * CONTROL_DT_S)
    assert late(world, 2.0).pose_age_s == pytest.approx(1.1), "an old picture is no news"


def test_one_jump_is_refused_and_many_are_told() -> None:
    world = driving()
    far = Pose(world.pose.x_m + 1.0, world.pose.y_m, 0.0)
    for count in range(1, JUMPS + 1):
        world.now_s += 0.02
        world.tell(far)
        guidance = world.navigator.look(world.now_s)
        assert guidance.pose_jump is (count >= JUMPS)
        assert guidance.pose is not None
        assert guidance.pose.x_m == pytest.approx(world.pose.x_m, abs=0.02)


def test_two_localizers_are_told() -> None:
    world = driving()
    for session in ("b" * 16, world.session, "b" * 16):
        world.now_s += 0.05
        world.tell(world.pose, session)
        guidance = world.navigator.look(world.now_s)
    assert guidance.duplicate_publisher


def test_off_the_map_is_told() -> None:
    world = World(Pose(0.05, 0.05, math.pi))
    for _ in range(3):
        world.turn()
    assert not world.guidance.off_map
    world.turn(0.1)
    assert world.guidance.off_map


def test_a_mission_ends_when_the_policy_no_longer_drives() -> None:
    world = driving()
    bench = Bench()
    assert world.navigator.status is not None
    bench.drive()
    world.navigator.on_tick(bench.runtime.step())
    assert world.navigator.status.phase == "driving"
    bench.runtime.ask(Command.STOP)
    world.navigator.on_tick(bench.runtime.step())
    status: Optional[object] = world.navigator.status
    assert status is not None
    assert (world.navigator.status.phase, world.navigator.status.reason) == (
        "stopped",
        "stop, by a person",
    )
    assert world.turn().path is None
    assert world.navigator.path_points == ()


def test_a_mission_that_is_stopped_in_the_turn_it_began_is_over() -> None:
    """Its click and the stop may come together, after a pause of the radio."""
    world, bench = driving(), Bench()
    bench.turn()
    for command in (Command.ARM, Command.AUTO, Command.STOP):
        bench.runtime.ask(command)
    world.navigator.on_tick(bench.runtime.step())
    assert world.navigator.status is not None
    assert world.navigator.status.phase == "stopped"
    assert world.turn().path is None, "who sends it again asks for a mission"


def past_a_turn() -> Path:
    """From the mission's start, past its first turn at a junction by the lane beside it."""
    route = plan_route(GRAPH, START, GOAL)
    for number, lane in enumerate(route.lanes):
        begins = GRAPH.lane_nodes[lane][0]
        for end, other in GRAPH.edges[begins]:
            if other == lane or number == 0:
                continue
            after = [GRAPH.lanes[n].control_points_m for _, n in GRAPH.edges[end][:1]]
            curves = [*route.curves_m[:number], GRAPH.lanes[other].control_points_m, *after]
            return Path.from_beziers(curves)
    raise AssertionError("no junction on the way")


def miss_the_turn(world: World) -> None:
    """Drive past it until the navigator minds."""
    past = past_a_turn()
    before = world.navigator.path_points
    while world.navigator.path_points == before and not world.guidance.off_path:
        assert past.project(*world.pose[:2]).arc_m < past.length_m - 0.1, "it never minded"
        world.follow(path_input(past, world.pose))


@pytest.mark.slow
def test_a_robot_that_missed_a_turn_goes_another_way() -> None:
    world = driving()
    miss_the_turn(world)
    assert not world.guidance.off_path
    assert world.navigator.status is not None
    assert "detour 1" in world.navigator.status.reason
    while not world.guidance.arrived:
        assert world.guidance.path is not None
        assert not world.guidance.off_path
        world.follow(world.guidance.path)
    assert math.hypot(world.pose.x_m - GOAL[0], world.pose.y_m - GOAL[1]) < ARRIVAL_M + 0.05


def test_but_not_for_ever(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("robot.navigation.navigator.DETOURS", 0)
    world = driving()
    miss_the_turn(world)
    assert world.guidance.off_path


def test_the_way_is_checked_by_the_heading_that_was_told_else_by_the_believed_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    seen: List[Pose] = []
    monkeypatch.setattr(WayCheck, "see", lambda _, __, pose: seen.append(pose))
    world = World(START)
    world.turn()
    world.tell(START._replace(heading_rad=START.heading_rad + 0.3))
    world.turn(seen=False)
    assert wrap_angle(seen[-1].heading_rad - START.heading_rad) == pytest.approx(0.3, abs=1e-6)
    world.tell(START)
    unknown = dataclasses.replace(world.messages[0].robots[0], heading_rad=None)
    world.messages = [dataclasses.replace(world.messages[0], robots=(unknown,))]
    world.turn(seen=False)
    assert abs(float(wrap_angle(seen[-1].heading_rad - START.heading_rad))) < 0.3


def test_a_route_that_comes_back_to_its_start_is_driven_from_its_start() -> None:
    """Its later part, the oncoming lane or the same crossing, may be nearer to the robot."""
    rng, tried = np.random.default_rng(1), 0
    while tried < 15:
        begins, ends = rng.choice(len(GRAPH.lanes), 2)
        at = GRAPH.lanes[begins].pose_at(rng.random())
        beside = at.to_world(np.array([[0.0, rng.uniform(-0.14, 0.14)]]))[0]
        pose = Pose(*beside.tolist(), float(wrap_angle(at.heading_rad + rng.normal(0.0, 0.3))))
        goal = GRAPH.lanes[ends].pose_at(rng.random())[:2]
        if not TOWN.on_road(*pose[:2]) or math.dist(pose[:2], goal) < 1.0:
            continue
        path = plan_path(GRAPH, pose, goal)
        if path.project(*pose[:2]).arc_m - path.project(*pose[:2], 0).arc_m < 0.3:
            continue
        tried += 1
        world = World(pose)
        for _ in range(4):
            world.turn()
        with suppress(PlanError):  # too far from it, or turned too far
            world.navigator.begin("m", goal)
            world.turn()
            status = world.navigator.status
            assert status.phase == "driving"
            assert status.remaining_m > path.length_m - 0.4
