"""The virtual robot meets what a robot in training meets: the same pictures, and the same tyres."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from robot.contract import ACTION_WHEELS, Action, ImageSpec
from robot.geometry import Pose
from robot.navigation.road_map import load_map
from sim_pybullet.look import NOMINAL, DriveLook, Look, SensorLook, TimingLook
from sim_pybullet.motors import PHYSICS_DT_S as TRAINING_DT_S
from sim_pybullet.motors import WheeledRobots
from sim_pybullet.randomise import load_look_sampler
from sim_pybullet.rendering.ray_camera import RayCamera
from sim_pybullet.sensing.camera_feed import CameraFeed
from sim_pybullet.town import Town
from sim_pybullet.traffic.crowd import duck_solids
from sim_pybullet.virtual.world import RolledWheels, VirtualWorld
from tests.robot.hat.rig import Rig, make_rig

DT_S = 1 / 60
LOOP = load_map("loop")
START = Pose(0.6, 0.2, 0.1)


def world_of(look: Look, rig: Rig | None = None, seed: int = 3) -> VirtualWorld:
    rig = rig or make_rig()
    world = VirtualWorld(LOOP, look, rig.hat, rig.clock, np.random.default_rng(seed))
    world.place(START)
    return world


def steps(rig: Rig, world: VirtualWorld, action: Action, seconds: float) -> None:
    """Carry out an action, physics looked after in every step."""
    end_s = rig.clock.now() + seconds
    while rig.clock.now() < end_s - 1e-3:  # a bus takes its time, too
        rig.drive(*ACTION_WHEELS[action], min(DT_S, end_s - rig.clock.now()))
        world.follow()


def since(start: Pose, end: Pose) -> Pose:
    """A pose in the frame of another."""
    x_m, y_m = start.to_robot(np.array(end[:2]))
    turned_rad = math.remainder(end.heading_rad - start.heading_rad, 2 * math.pi)
    return Pose(float(x_m), float(y_m), turned_rad)


def driven(look: Look, action: Action = Action.STRAIGHT, seed: int = 3) -> Pose:
    """Where two seconds of an action lead a robot that drives straight on."""
    rig = make_rig()
    world = world_of(look, rig, seed)
    with rig.driver:
        steps(rig, world, Action.STRAIGHT, 1.0)
        start = world.pose
        steps(rig, world, action, 2.0)
    end = world.pose
    world.close()
    return since(start, end)


def in_training(drive: DriveLook, action: Action) -> Pose:
    """Where the batched world's motors lead, as ``driven``."""
    robots, town = WheeledRobots(1), Town([[]], 1)
    robots.reset(0, drive)
    rng, poses = np.random.default_rng(0), []
    for chosen, seconds in ((Action.STRAIGHT, 1.0), (action, 2.0)):
        for _ in range(round(seconds / TRAINING_DT_S)):
            town.step(robots.step(np.array([chosen]), rng))
        poses.append(Pose(*town.poses[0]))
    town.close()
    return since(*poses)


def test_the_nominal_look_shows_what_a_bare_camera_sees() -> None:
    world = world_of(NOMINAL)
    camera = RayCamera(ImageSpec(), 1)
    camera.set_robot(0, world.scene, NOMINAL.rig())
    assert np.array_equal(world.see(), camera.render(np.array([world.pose]))[0])
    world.close()


def test_who_is_around_is_seen_where_it_is_and_only_there() -> None:
    rig = make_rig()
    rng = np.random.default_rng(3)
    world = VirtualWorld(LOOP, NOMINAL, rig.hat, rig.clock, rng, (duck_solids(),))
    world.place(START)
    alone = world.see()
    world.around[:] = [START.moved(0.3, 0.0)]
    world.place(START)
    camera = RayCamera(ImageSpec(), 1, (duck_solids(),))
    camera.set_robot(0, world.scene, NOMINAL.rig())
    expected = camera.render(np.array([START]), None, world.around[None])[0]
    assert np.array_equal(world.see(), expected)
    assert not np.array_equal(expected, alone)
    world.around[:] = math.nan
    world.place(START)
    assert np.array_equal(world.see(), alone)
    world.close()


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("source", ["randomised", "reality"])
def test_a_look_and_a_pose_give_the_picture_of_training(source: str, seed: int) -> None:
    look = load_look_sampler(source)(np.random.default_rng(seed))
    look = replace(look, light=replace(look.light, gloss=0.5), timing=TimingLook(0.07))
    rig = make_rig()
    world = world_of(look, rig)
    trained = CameraFeed(RayCamera(ImageSpec(), 1), 1)
    for pose in (Pose(0.5, 0.25, 0.0), Pose(1.5, 0.3, 1.2), Pose(0.3, 0.9, -2.0)):
        world.place(pose)
        trained.begin(0, world.scene, look, np.array(pose))
        world._rng = np.random.default_rng(7)  # both draw the same noise
        seen, expected = world.see(), trained.pictures(np.random.default_rng(7))[0]
        assert np.array_equal(seen, expected)
    world.close()


def test_a_moving_camera_is_as_late_and_smeared_as_in_training() -> None:
    """Training looks at every second pose of the bench, so ripples of the steps come out anew."""
    look = replace(
        NOMINAL, sensor=SensorLook(shutter_s=0.04), timing=TimingLook(camera_delay_s=0.1)
    )
    rig = make_rig()
    world, trained = world_of(look, rig), CameraFeed(RayCamera(ImageSpec(), 1), 1)
    trained.begin(0, world.scene, look, np.array(world.pose))
    with rig.driver:
        for _ in range(30):
            steps(rig, world, Action.LEFT, TRAINING_DT_S)
            trained.record(np.array([world.pose]))
    seen = world.see().astype(int)
    expected = trained.pictures(np.random.default_rng(0))[0].astype(int)
    sharp = replace(look, sensor=SensorLook(shutter_s=0.0))
    world._look = sharp
    unsmeared = CameraFeed(RayCamera(ImageSpec(), 1), 1)
    unsmeared.begin(0, world.scene, sharp, np.array(world.pose))
    other = unsmeared.pictures(np.random.default_rng(0))[0].astype(int)
    world.close()
    assert np.abs(seen - expected).mean() < 1.0
    assert np.abs(seen - other).mean() > 5.0, "a late, smeared picture is another one"


def test_a_picture_is_as_old_as_the_look_says() -> None:
    looks = (NOMINAL, replace(NOMINAL, timing=TimingLook(camera_delay_s=0.1)))
    shown = []
    for look in looks:
        rig, frames = make_rig(), []
        world = world_of(look, rig)
        with rig.driver:
            for _ in range(60):
                steps(rig, world, Action.SLIGHT_LEFT, DT_S)
                frames.append(world.see())
        world.close()
        shown.append(frames)
    now, late = shown
    assert not np.array_equal(now[54], now[48])
    for k in (30, 42, 54):
        assert np.abs(late[k].astype(int) - now[k - 6]).max() <= 1


def test_as_many_frames_come_twice_as_in_training() -> None:
    look = replace(NOMINAL, timing=TimingLook(frame_skip=0.3))
    rig = make_rig()
    world = world_of(look, rig)
    trained = CameraFeed(RayCamera(ImageSpec(), 1), 1)
    trained.begin(0, world.scene, look, np.array(world.pose))
    world._rng, rng = np.random.default_rng(5), np.random.default_rng(5)
    last = world.see()
    last_there = trained.pictures(rng)[0]
    again, there = [], []
    with rig.driver:
        for _ in range(200):
            steps(rig, world, Action.SLIGHT_LEFT, 2 * DT_S)
            trained.record(np.array([world.pose]))
            frame, expected = world.see(), trained.pictures(rng)[0]
            again.append(np.array_equal(frame, last))
            there.append(np.array_equal(expected, last_there))
            last, last_there = frame, expected
    world.close()
    assert 0.2 < np.mean(again) < 0.4
    assert abs(np.mean(again) - np.mean(there)) < 0.05


def test_a_robot_that_is_put_down_sees_nothing_of_before() -> None:
    look = replace(NOMINAL, timing=TimingLook(camera_delay_s=0.2, frame_skip=1.0))
    world = world_of(look)
    world.see()
    there = Pose(1.5, 0.3, 1.2)
    world.place(there)
    seen = world.see()
    fresh = world_of(look)
    fresh.place(there)
    assert np.array_equal(seen, fresh.see())
    world.close()
    fresh.close()


def test_a_robot_that_is_put_down_has_no_motion_under_way() -> None:
    rig = make_rig()
    world = world_of(replace(NOMINAL, drive=DriveLook(delay_s=0.3)), rig)
    with rig.driver:
        steps(rig, world, Action.STRAIGHT, 1.5)
        world.place(START)
        steps(rig, world, Action.STRAIGHT, 0.2)
    assert math.dist(world.pose[:2], START[:2]) < 0.002
    world.close()


def test_noise_follows_the_seed() -> None:
    look = replace(NOMINAL, sensor=SensorLook(noise=6.0))
    frames = []
    for seed in (1, 1, 2):
        world = world_of(look, seed=seed)
        frames.append([world.see(), world.see()])
        world.close()
    same, again, other = frames
    assert np.array_equal(same, again)
    assert not np.array_equal(same[0], other[0])
    assert not np.array_equal(same[0], same[1]), "every frame has noise of its own"


def test_nominal_wheels_go_bit_for_bit_where_their_rims_roll(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rig = make_rig()
    world, rolled = world_of(NOMINAL, rig), RolledWheels(rig.hat, rig.clock)
    twists: list[list[float]] = []
    step = Town.step
    monkeypatch.setattr(
        Town, "step", lambda town, twist: (twists.append(twist[0].tolist()), step(town, twist))
    )
    with rig.driver:
        for action in (Action.STRAIGHT, Action.SLIGHT_LEFT, Action.RIGHT):
            for _ in range(40):
                rig.drive(*ACTION_WHEELS[action], DT_S)
                left, right = rolled.since_last().tolist()
                world.follow()
                assert twists[-1] == [0.5 * (left + right), (right - left) / 0.102]
    assert max(forward for forward, _ in twists) > 0.25
    world.close()


DRIVES: dict[str, DriveLook] = {
    "gain": DriveLook(gain=0.85, noise=0.0),
    "trim": DriveLook(trim=0.04, noise=0.0),
    "turn gain": DriveLook(turn_gain=0.8, noise=0.0),
    "lag": DriveLook(forward_lag_s=0.3, turn_lag_s=0.3, noise=0.0),
    "delay": DriveLook(delay_s=0.15, noise=0.0),
    "all": DriveLook(0.15, 0.15, 0.1, 0.9, -0.03, 0.85, 0.0),
}


@pytest.mark.parametrize(
    ("name", "action"),
    [(name, Action.SLIGHT_RIGHT) for name in DRIVES]
    + [(name, Action.STRAIGHT) for name in ("gain", "trim", "all")],
)
def test_a_worse_drive_changes_a_way_as_much_as_in_training(name: str, action: Action) -> None:
    drive = DRIVES[name]
    changed = driven(replace(NOMINAL, drive=drive), action)
    expected = np.subtract(in_training(drive, action), in_training(DriveLook(noise=0.0), action))
    changes = np.subtract(changed, driven(NOMINAL, action))
    np.testing.assert_allclose(changes, expected, atol=0.015)
    assert np.abs(expected).max() > 0.04, "the case is worth something"


@pytest.mark.parametrize("change", [{"forward_lag_s": 0.0}, {"turn_lag_s": 0.01}, {"noise": 0.0}])
def test_nothing_is_faster_or_steadier_than_the_steps(change: dict[str, float]) -> None:
    better = replace(NOMINAL, drive=replace(NOMINAL.drive, **change))
    assert driven(better, Action.LEFT) == driven(NOMINAL, Action.LEFT)


def test_uneven_wheels_follow_the_seed() -> None:
    look = replace(NOMINAL, drive=DriveLook(noise=0.2))
    same, again, other = (driven(look, seed=seed) for seed in (1, 1, 2))
    assert same == again
    assert same != other
    assert same != driven(NOMINAL, seed=1)
