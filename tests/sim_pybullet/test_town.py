"""What bodies must do: follow, stop at walls, pass through each other, repeat themselves."""

from collections.abc import Callable, Iterator

import numpy as np
import pytest

from robot.contract import ACTION_TWISTS
from robot.geometry import Pose, wrap_angle
from sim_pybullet.motors import PHYSICS_DT_S
from sim_pybullet.scene import Solid
from sim_pybullet.town import Drive, Town

GREY = (120.0, 120.0, 120.0)
WALL = Solid("box", 1.0, 0.0, 0.0, (0.1, 2.0, 0.3), GREY)
POST = Solid("cylinder", 0.0, 1.0, 0.0, (0.2, 0.2, 0.3), GREY)
BRIDGE = Solid("box", 0.0, -1.0, 0.0, (2.0, 0.2, 0.1), GREY, base_m=0.3)
GHOST = Solid("box", -0.5, 0.0, 0.0, (0.1, 1.0, 0.3), GREY, collides=False)
FRONT_M = 0.066  # of the chassis, ahead of the axle
CHASSIS_M, CHASSIS_MIDDLE_M = (0.18, 0.13), -0.024  # length and width; ahead of the axle

MakeTown = Callable[..., Town]


@pytest.fixture
def make_town() -> Iterator[MakeTown]:
    towns: list[Town] = []

    def make(*arguments: object, **options: object) -> Town:
        towns.append(Town(*arguments, **options))
        return towns[-1]

    yield make
    for town in towns:
        town.close()


def roll(town: Town, forward: float, turn: float, seconds: float) -> np.ndarray:
    """Poses (T, N, 3) while every robot drives at the same twist."""
    twists = np.tile((forward, turn), (len(town.poses), 1))
    poses = []
    for _ in range(round(seconds / PHYSICS_DT_S)):
        town.step(twists)
        poses.append(town.poses)
    return np.array(poses)


@pytest.mark.parametrize("twist", ACTION_TWISTS)
def test_planar_drives_exact_arcs(make_town: MakeTown, twist: tuple[float, float]) -> None:
    town = make_town([()], 1)
    start = Pose(0.3, -0.2, 2.5)
    town.place(0, start)
    end = roll(town, *twist, 2.0)[-1, 0]
    expected = start.moved(2.0 * twist[0], 2.0 * twist[1])
    np.testing.assert_allclose(end[:2], expected[:2], atol=1e-9)
    assert abs(wrap_angle(end[2] - expected[2])) < 1e-9


@pytest.mark.parametrize("twist", ACTION_TWISTS)
def test_wheels_agree_with_planar(make_town: MakeTown, twist: tuple[float, float]) -> None:
    """Within 4 % of the way driven, over 1.2 m."""
    seconds = 1.2 / twist[0]
    paths = [roll(make_town([()], 1, drive), *twist, seconds) for drive in ("planar", "wheels")]
    apart = np.hypot(*(paths[0] - paths[1])[:, 0, :2].T)
    assert apart.max() < 0.04 * 1.2


def test_wheeled_robots_stay_on_the_floor_and_pass_through_each_other(make_town: MakeTown) -> None:
    town = make_town([()], 2, "wheels")
    town.place(0, Pose(0.0, 0.0, 0.0))
    town.place(1, Pose(1.0, 0.0, np.pi))
    roll(town, 0.3, 0.0, 3.0)
    np.testing.assert_allclose(town.poses[:, 0], (0.9, 0.1), atol=0.03)
    assert not town.collided.any()


def test_other_solids_take_the_place_of_those_of_a_world_and_of_no_other(
    make_town: MakeTown,
) -> None:
    town = make_town([(WALL,), (WALL,)], 2)
    town.furnish(0, ())
    for robot in (0, 1):
        town.place(robot, Pose(0.0, 0.0, 0.0), robot)
    roll(town, 0.3, 0.0, 5.0)
    assert town.collided.tolist() == [False, True]
    assert town.poses[0, 0] == pytest.approx(1.5, abs=0.01)
    town.furnish(0, (WALL,))
    town.place(0, Pose(0.0, 0.0, 0.0), 0)
    roll(town, 0.3, 0.0, 5.0)
    assert town.collided.all()


@pytest.mark.parametrize("drive", ["planar", "wheels"])
def test_walls_and_posts_stop_robots(make_town: MakeTown, drive: Drive) -> None:
    town = make_town([(WALL, POST)], 2, drive)
    town.place(0, Pose(0.0, 0.0, 0.0))
    town.place(1, Pose(0.0, 0.0, np.pi / 2))
    way = roll(town, 0.3, 0.0, 5.0)
    assert way[-1, 0, 0] == pytest.approx(0.95 - FRONT_M, abs=0.02)
    assert way[-1, 1, 1] == pytest.approx(0.9 - FRONT_M, abs=0.02)
    assert town.collided.all()


def gap_to_post_m(x_m: float, y_m: float, heading_rad: float) -> float:
    """From the chassis, a rectangle, to the post of 0.2 m at (0, 1); below 0 inside it."""
    c, s = np.cos(heading_rad), np.sin(heading_rad)
    ahead, left = c * -x_m + s * (1.0 - y_m), -s * -x_m + c * (1.0 - y_m)
    middle_m, half_m = CHASSIS_MIDDLE_M, 0.5 * np.array(CHASSIS_M)
    beyond = np.abs([ahead - middle_m, left]) - half_m
    return float(np.hypot(*np.maximum(beyond, 0.0)) + min(beyond.max(), 0.0)) - 0.1


def test_who_is_millimetres_from_a_post_does_not_touch_it(make_town: MakeTown) -> None:
    """Bullet tells of pairs that are some millimetres apart, too; touching is less than one."""
    town, rng = make_town([(POST,)], 1), np.random.default_rng(0)
    told: dict[bool, list[bool]] = {True: [], False: []}
    while min(map(len, told.values())) < 150:
        pose = Pose(*rng.uniform((-0.25, 0.75, -np.pi), (0.25, 1.25, np.pi)).tolist())
        gap_m = gap_to_post_m(*pose)
        if -0.004 < gap_m < -0.001 or 0.0015 < gap_m < 0.0038:
            town.place(0, pose)
            town.step(np.zeros((1, 2)))
            told[gap_m < 0.0].append(bool(town.collided[0]))
    assert all(told[True])
    assert not any(told[False])


def test_collision_is_told_within_one_step_and_never_too_soon(make_town: MakeTown) -> None:
    town, touched = make_town([(WALL,)], 1), False
    for _ in range(200):
        town.step(np.array([[0.3, 0.0]]))
        touches = 0.95 - FRONT_M - town.poses[0, 0] < 1e-3
        assert touched <= town.collided[0] <= touches
        touched = touches
    assert touched


def test_bridges_and_what_does_not_collide_are_passed(make_town: MakeTown) -> None:
    town = make_town([(BRIDGE, GHOST)], 2)
    town.place(0, Pose(0.0, -0.5, -np.pi / 2))
    town.place(1, Pose(0.0, 0.0, np.pi))
    way = roll(town, 0.3, 0.0, 4.0)
    np.testing.assert_allclose(way[-1, :, :2], [[0.0, -1.7], [-1.2, 0.0]], atol=1e-6)


def test_worlds_do_not_meet_and_keep_their_own_frames(make_town: MakeTown) -> None:
    town = make_town([(WALL,), (), (WALL,)], 3)
    for i in range(3):
        town.place(i, Pose(0.0, 0.0, 0.0), world=i)
        assert tuple(town.poses[i]) == (0.0, 0.0, 0.0)
    ends = roll(town, 0.3, 0.0, 5.0)[-1]
    assert ends[1, 0] == pytest.approx(1.5)
    np.testing.assert_allclose(ends[0], ends[2], atol=1e-9)
    np.testing.assert_array_equal(town.collided, (True, False, True))


@pytest.mark.parametrize("drive", ["planar", "wheels"])
def test_same_twists_same_trajectory_bit_for_bit(make_town: MakeTown, drive: Drive) -> None:
    twists = np.random.default_rng(3).uniform((0.0, -2.0), (0.5, 2.0), (60, 4, 2))
    runs = []
    for _ in range(2):
        town, poses = make_town([(WALL, POST)], 4, drive), []
        for twist in twists:
            town.step(twist)
            poses.append(town.poses)
        runs.append(np.array(poses))
    np.testing.assert_array_equal(runs[0], runs[1])


def test_many_solids_fit_into_one_world(make_town: MakeTown) -> None:
    posts = [Solid("cylinder", 0.5 * i, 0.6, 0.0, (0.1, 0.1, 0.3), GREY) for i in range(50)]
    town = make_town([posts], 50)
    for i in range(50):
        town.place(i, Pose(0.5 * i, 0.0, np.pi / 2))
    roll(town, 0.3, 0.0, 3.0)
    assert town.collided.all()
