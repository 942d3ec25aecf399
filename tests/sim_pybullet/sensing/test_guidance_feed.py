"""What robots believe of where they are on their paths."""

import math
from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pytest

from robot.contract import ImageSpec
from robot.navigation.path import path_inputs
from robot.navigation.road_map import load_map
from sim_pybullet.batch import BatchWorld
from sim_pybullet.look import ARENA_POSE, NOMINAL, DriveLook, Look, PoseLook
from sim_pybullet.sensing.guidance_feed import GuidanceFeed, PoseSources
from sim_pybullet.tasks.navigation import Navigation
from tests.sim_pybullet.flat_camera import PoseCamera

ARENA = load_map("arena")
ROBOTS = 12


def make_world(*looks: Look, seed: int = 0) -> BatchWorld:
    return BatchWorld(Navigation([ARENA], ROBOTS), looks, seed=seed, camera=PoseCamera(ROBOTS))


def drive(world: BatchWorld, steps: int) -> tuple[np.ndarray, np.ndarray]:
    """The expert drives; position errors (T, N) [m] of the belief, and heading errors [rad]."""
    world.reset()
    errors = []
    for _ in range(steps):
        world.step(world.expert_actions())
        assert world.guidance is not None
        errors.append(world.guidance.poses - world.poses)
    delta = np.array(errors)
    return np.hypot(delta[..., 0], delta[..., 1]), np.angle(np.exp(1j * delta[..., 2]))


def true_inputs(world: BatchWorld) -> np.ndarray:
    return path_inputs(world.task.paths, world.poses, world.task.course.arc_m)


def test_without_error_the_inputs_are_those_of_the_true_pose() -> None:
    slippery = replace(NOMINAL, drive=DriveLook(gain=0.8, trim=0.05, turn_gain=0.9))
    world = make_world(slippery, replace(slippery, pose=PoseLook(correlation_s=9.0)))
    np.testing.assert_allclose(world.reset().path, true_inputs(world), atol=0.05)
    for _ in range(40):
        step = world.step(world.expert_actions())
        np.testing.assert_array_equal(step.observation.path, true_inputs(world))
    world.close()


def test_with_error_the_belief_is_off_by_about_the_error_and_drifts() -> None:
    world = make_world(replace(NOMINAL, pose=ARENA_POSE))
    position_m, heading_rad = drive(world, 150)
    assert 0.02 < position_m.mean() < 0.06
    assert position_m.max() < 0.25
    assert math.radians(1.0) < np.abs(heading_rad).mean() < math.radians(8.0)
    assert not np.allclose(world._observe().path, true_inputs(world), atol=0.01)
    world.close()


def test_dead_reckoning_carries_through_a_gap() -> None:
    """One pose at the start, then never again: exact wheels keep the belief exact."""
    alone = PoseLook(position_m=1e-6, dropout_per_s=10.0, dropout_s=1e6)
    exact = DriveLook(noise=0.0, delay_s=0.05)
    world = make_world(Look(drive=exact, pose=alone))
    position_m, heading_rad = drive(world, 60)
    assert position_m.max() < 2e-3
    assert np.abs(heading_rad).max() < 2e-3
    world.close()


def test_steps_do_not_know_of_slip() -> None:
    alone = PoseLook(position_m=1e-6, dropout_per_s=10.0, dropout_s=1e6)
    world = make_world(Look(drive=DriveLook(noise=0.0, gain=0.9), pose=alone))
    position_m, _ = drive(world, 20)
    driven_m = 20 * 0.03
    assert position_m[-1].mean() == pytest.approx(0.1 * driven_m, rel=0.4)
    world.close()


def test_robots_with_and_without_error_share_a_world() -> None:
    world = make_world(NOMINAL, replace(NOMINAL, pose=ARENA_POSE))
    world.reset()
    assert world.guidance is not None
    wrong = np.abs(world.guidance.poses - world.poses).max(axis=1) > 1e-9
    assert 0 < wrong.sum() < ROBOTS
    world.close()


def test_a_new_episode_begins_at_the_new_place() -> None:
    world = make_world(replace(NOMINAL, pose=ARENA_POSE))
    world.reset()
    seen = 0
    for _ in range(60):
        step = world.step(np.zeros(ROBOTS, dtype=int))  # in circles: soon off the path
        assert world.guidance is not None
        delta = world.guidance.poses[step.finished.robots] - world.poses[step.finished.robots]
        assert np.all(np.hypot(delta[:, 0], delta[:, 1]) < 0.15)
        seen += len(delta)
    assert seen > ROBOTS
    world.close()


def test_the_same_seed_gives_the_same_inputs() -> None:
    runs = []
    for _ in range(2):
        world = make_world(replace(NOMINAL, pose=ARENA_POSE), seed=3)
        world.reset()
        runs.append([world.step(world.expert_actions()).observation.path for _ in range(30)])
        world.close()
    np.testing.assert_array_equal(runs[0], runs[1])


def test_who_begins_anew_has_driven_nothing() -> None:
    """Neither where it was nor steps that were counted on the way belong to the next episode."""
    feed, rng, robots = GuidanceFeed(2), np.random.default_rng(0), np.arange(2)
    looks = [PoseLook(position_m=1e-6)] * 2
    start = np.array([[1.0, 1.0, 0.0], [2.0, 1.0, 0.0]])
    feed.begin(robots, looks, start, np.zeros(2, int), [rng] * len(robots))
    for _ in range(7):
        feed.record(np.array([[0.3, 0.0], [0.3, 0.0]]))
    there = np.array([[0.2, 2.0, 1.5], [2.0 + 0.3 * 7 / 30, 1.0, 0.0]])
    feed.begin(np.array([0]), looks[:1], there, np.zeros(2, int), [rng])
    np.testing.assert_allclose(feed.poses[0], there[0], atol=1e-3)
    feed.update(there, rng)
    np.testing.assert_allclose(feed.poses, there, atol=5e-3)


def test_sight_corrects_each_robot_by_the_map_that_it_is_on() -> None:
    sight, loop = Mock(), load_map("loop")
    sight.contract.image = ImageSpec()
    feed = GuidanceFeed(3, PoseSources("start", sight), [ARENA, loop])
    feed._fix.see = Mock()  # type: ignore[method-assign]
    who, images = np.array([0, 2]), np.full((2, *ImageSpec().shape), 7, np.uint8)
    feed.see(images, who, np.array([True, False, True]), np.array([1, 0, 1]))
    assert [view.road_map for view in feed._fix.views] == [loop, ARENA, loop]
    assert sight.call_args.args[0].mean(axis=(1, 2, 3)).tolist() == [7.0, 0.0, 7.0]
