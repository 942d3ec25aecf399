"""The figures by which a robot gives up, as literals: a constant that moves fails here."""

from __future__ import annotations

import math

import numpy as np
import pytest

from robot.geometry import Pose
from robot.navigation.fusion import PoseFusion
from tests.robot.navigation.test_navigator import START, TOWN, World, driving

TILE_M = 0.585


def told_to_drive() -> World:
    """On the mission's first, straight lane."""
    assert TOWN.tile_size_m == TILE_M
    return driving()


def jump_aside(world: World, aside_m: float) -> None:
    """Steps and poses agree that the robot is so far to the left, as far as it faces now."""
    world.turn(0.0, math.pi / 2)
    world.turn(aside_m)
    world.turn(0.0, -math.pi / 2)


@pytest.mark.parametrize(("aside_m", "off"), [(0.13, False), (0.165, True), (-0.165, True)])
def test_a_quarter_of_a_tile_beside_its_path_is_off(aside_m: float, off: bool) -> None:
    world = told_to_drive()
    jump_aside(world, aside_m)
    detour = world.navigator.status is not None and "detour" in world.navigator.status.reason
    assert (world.guidance.off_path or detour) is off


@pytest.mark.parametrize(("turned_deg", "off"), [(95.0, False), (105.0, True), (-105.0, True)])
def test_a_hundred_degrees_from_its_path_is_off(turned_deg: float, off: bool) -> None:
    world = told_to_drive()
    for _ in range(5):
        world.turn(0.0, math.radians(turned_deg) / 5)
    for _ in range(3):
        world.turn()
    assert world.guidance.off_path is off


@pytest.mark.parametrize(("left_m", "arrived"), [(0.06, False), (0.045, True)])
def test_five_centimetres_before_its_destination_it_has_arrived(
    left_m: float, arrived: bool
) -> None:
    world = World(START)
    for _ in range(3):
        world.turn()
    ahead = (math.cos(START.heading_rad), math.sin(START.heading_rad))
    there = (START.x_m + 0.4 * ahead[0], START.y_m + 0.4 * ahead[1])
    world.navigator.begin("short", there)
    driven_m = 0.4 - left_m
    for _ in range(15):
        world.turn(driven_m / 15)
    assert world.guidance.arrived is arrived


@pytest.mark.parametrize(("poses", "jumped"), [(4, False), (5, True)])
def test_five_unbelievable_poses_in_a_row_are_a_jump(poses: int, jumped: bool) -> None:
    world = told_to_drive()
    for _ in range(poses):
        world.now_s += 0.02
        world.tell(Pose(world.pose.x_m + 1.0, world.pose.y_m, 0.0))
        guidance = world.navigator.look(world.now_s)
    assert guidance.pose_jump is jumped


def settled() -> PoseFusion:
    """A robot that stood at the origin for two seconds."""
    fusion = PoseFusion()
    for tick in range(20):
        fusion.move(np.zeros(1), np.zeros(1), 0.1 * tick)
        fusion.measure(np.zeros((1, 3)), np.array([0.1 * tick]))
    return fusion


@pytest.mark.parametrize(("off_m", "believed"), [(0.05, True), (0.085, False)])
def test_the_filter_believes_what_one_pose_in_a_thousand_exceeds(
    off_m: float, believed: bool
) -> None:
    fusion = settled()
    fusion.move(np.zeros(1), np.zeros(1), 2.0)
    fusion.measure(np.array([[off_m, 0.0, 0.0]]), np.array([2.0]))
    assert fusion.rejected[0] == (0 if believed else 1)


@pytest.mark.parametrize(("poses", "believed"), [(5, False), (6, True)])
def test_after_five_refused_poses_the_sixth_is_where_it_is(poses: int, believed: bool) -> None:
    fusion = settled()
    for tick in range(20, 20 + poses):
        fusion.move(np.zeros(1), np.zeros(1), 0.1 * tick)
        fusion.measure(np.array([[1.0, 1.0, 0.0]]), np.array([0.1 * tick]))
    assert (math.hypot(*(fusion.poses[0, :2] - 1.0)) < 0.01) is believed


@pytest.mark.parametrize(("ago_s", "taken"), [(2.8, True), (3.2, False)])
def test_pictures_older_than_three_seconds_are_refused(ago_s: float, taken: bool) -> None:
    fusion = settled()
    for tick in range(20, 81):
        fusion.move(np.zeros(1), np.zeros(1), 0.1 * tick)
    fusion.measure(np.zeros((1, 3)), np.array([8.0 - ago_s]))
    assert fusion.rejected[0] == (0 if taken else 1)


def test_wheels_off_by_more_than_wheels_can_be_are_a_doubt() -> None:
    """They are 30 % larger than they were said to be, and the poses tell so."""
    world = told_to_drive()
    for _ in range(300):
        world.now_s += 0.1
        world.pose = world.pose.moved(0.026, 0.1)
        world.odometry = world.odometry.moved(0.02, 0.1)
        world.tell(world.pose)
        if world.navigator.look(world.now_s).pose_doubt:
            return
    raise AssertionError("nobody minds")
