"""The batched world: the order of things, episodes, reproducibility."""

import gc
import weakref
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest

from robot.contract import CONTROL_DT_S, Action
from robot.errors import ConfigError, ContractError
from robot.navigation.road_map import load_map
from sim_pybullet.batch import BatchStep, BatchWorld
from sim_pybullet.episodes import DrawnEpisodes, LookPool, NumberedEpisodes
from sim_pybullet.look import NOMINAL, DriveLook, GroundLook, Look, TimingLook
from sim_pybullet.motors import PHYSICS_DT_S
from sim_pybullet.randomise import load_look_sampler
from sim_pybullet.tasks.lane_keeping import LaneKeeping
from sim_pybullet.tasks.navigation import Navigation
from tests.sim_pybullet.db18 import DB18_DRIVE
from tests.sim_pybullet.flat_camera import PoseCamera, shown_poses

LOOP = load_map("loop")
EXACT = replace(NOMINAL, drive=DriveLook(forward_lag_s=0.0, turn_lag_s=0.0, noise=0.0))


def make_world(n: int = 4, looks: tuple[Look, ...] = (NOMINAL,), seed: int = 0) -> BatchWorld:
    return BatchWorld(LaneKeeping([LOOP], n), looks, seed=seed, camera=PoseCamera(n))


@pytest.fixture
def world() -> Iterator[BatchWorld]:
    made = make_world()
    yield made
    made.close()


def drive(world: BatchWorld, steps: int, seed: int = 0) -> list[BatchStep]:
    rng = np.random.default_rng(seed)
    world.reset()
    return [world.step(rng.integers(5, size=world.n_robots)) for _ in range(steps)]


def test_a_decision_is_a_tenth_of_a_second_of_the_action() -> None:
    world = make_world(looks=(EXACT,))
    world.reset()
    before = world.poses
    world.step(np.full(4, Action.STRAIGHT))
    moved = np.hypot(*(world.poses - before)[:, :2].T)
    np.testing.assert_allclose(moved, 0.3 * CONTROL_DT_S, atol=1e-9)
    assert pytest.approx(3 * PHYSICS_DT_S) == CONTROL_DT_S
    world.close()


def test_the_picture_shows_where_the_robots_are_now(world: BatchWorld) -> None:
    first = world.reset()
    np.testing.assert_allclose(shown_poses(first.image), world.poses, atol=1e-3)
    for step in drive(world, 30):
        assert step.observation.path is None
    np.testing.assert_allclose(shown_poses(step.observation.image), world.poses, atol=1e-3)


def test_an_ended_episode_keeps_its_last_picture_and_the_next_begins(world: BatchWorld) -> None:
    ended = 0
    for step in drive(world, 120):
        robots = step.finished.robots
        np.testing.assert_array_equal(
            robots, np.flatnonzero(step.task.terminated | step.task.truncated)
        )
        last = shown_poses(step.finished.observation.image)
        if len(robots):
            at = world.task.paths.project(shown_poses(step.observation.image)[:, :2])
            assert np.abs(at.offset_m[robots]).max() < 0.03  # new starts are in the lane
            offsets = step.course.offset_m[robots]
            assert np.all((np.abs(offsets) > 0.1) | step.task.truncated[robots])
            assert np.abs(last - shown_poses(step.observation.image)[robots]).max() > 0.01
        ended += len(robots)
        assert len(step.finished.metrics) == len(robots) == len(last)
    assert ended > 4


def test_metrics_are_those_of_the_episode(world: BatchWorld) -> None:
    steps = drive(world, 120)
    lived = np.zeros(4, dtype=int)
    for step in steps:
        lived += 1
        for i, metrics in zip(step.finished.robots, step.finished.metrics, strict=True):
            assert metrics.survival_time_s == pytest.approx(lived[i] * CONTROL_DT_S)
            lived[i] = 0


def test_same_seed_same_drive_bit_for_bit_and_another_seed_another() -> None:
    looks = (replace(NOMINAL, drive=DB18_DRIVE), NOMINAL)
    runs = []
    for seed in (1, 1, 2):
        world = make_world(looks=looks, seed=seed)
        runs.append([(s.observation.image, s.reward) for s in drive(world, 80)])
        world.close()
    for a, b in zip(runs[0], runs[1], strict=True):
        np.testing.assert_array_equal(a[0], b[0])
        np.testing.assert_array_equal(a[1], b[1])
    assert not np.array_equal(runs[0][0][0], runs[2][0][0])


def test_seeding_again_repeats_the_drive(world: BatchWorld) -> None:
    world.seed(7)
    first = [s.reward for s in drive(world, 60)]
    world.seed(7)
    np.testing.assert_array_equal(first, [s.reward for s in drive(world, 60)])


def test_robots_do_not_know_of_each_other() -> None:
    """Robot 0 drives alike whatever the others do."""
    paths = []
    for others in (Action.LEFT, Action.RIGHT):
        world = make_world(looks=(EXACT,))
        world.reset()
        actions = np.array([Action.STRAIGHT, others, others, others])
        paths.append([world.step(actions).course.offset_m[0] for _ in range(12)])
        world.close()
    np.testing.assert_array_equal(paths[0], paths[1])


@pytest.mark.parametrize("actions", [[0, 1, 2], [0, 1, 2, 5], [0, 1, 2, -1], [0.0, 1.0, 2.0, 3.0]])
def test_actions_beyond_the_contract_are_refused(world: BatchWorld, actions: list[int]) -> None:
    world.reset()
    with pytest.raises(ContractError, match=r"whole numbers from 0 to 4"):
        world.step(np.array(actions))


def test_robots_are_told_their_last_commands_the_oldest_first() -> None:
    task = LaneKeeping([LOOP], 4)
    world = BatchWorld(task, (NOMINAL,), camera=PoseCamera(4), commands=5)
    assert world.told == 10
    np.testing.assert_array_equal(world.reset().path, np.zeros((4, 10), np.float32))
    wheels = (0.0576, 0.3024), (0.2541, 0.3459), (0.3, 0.3), (0.3459, 0.2541), (0.3024, 0.0576)
    sent = [np.zeros((4, 2))] * 5
    for action in range(5):
        seen = world.step(np.full(4, action)).observation.path
        sent.append(np.tile(wheels[action], (4, 1)) / 0.3459)
        np.testing.assert_allclose(seen, np.hstack(sent[-5:]), atol=1e-6)
    shares = np.linspace(-1.0, 1.0, 8).reshape(4, 2)
    seen = world.step(shares).observation.path
    assert seen is not None
    np.testing.assert_allclose(seen[:, -2:], shares, atol=1e-6)
    ended = None
    while ended is None:
        step = world.step(np.array([0, 2, 2, 2]))
        ended = next(iter(step.finished.robots.tolist()), None)
    assert step.finished.robots.tolist() == [0]
    assert step.observation.path is not None
    assert step.finished.observation.path is not None
    assert not step.observation.path[ended].any(), "a new episode begins at rest"
    assert step.finished.observation.path[0].all(), "the last of the old one was driven"
    seen = world.step(np.array([0, 2, 2, 2])).observation.path
    assert seen is not None
    assert seen[1:].all(), "the others drive on"
    assert (seen[0] != 0.0).tolist() == [False] * 8 + [True] * 2
    world.close()


def test_the_path_comes_before_the_last_commands() -> None:
    arena = load_map("arena")
    worlds = [
        BatchWorld(Navigation([arena], 2), (NOMINAL,), camera=PoseCamera(2), commands=each)
        for each in (0, 5)
    ]
    assert [world.told for world in worlds] == [10, 20]
    path, both = (world.reset().path for world in worlds)
    assert path is not None
    assert both is not None
    assert both.shape == (2, 20)
    assert both.dtype == np.float32
    np.testing.assert_array_equal(both[:, :10], path)


def test_an_episode_has_one_look_of_a_list() -> None:
    dark = replace(NOMINAL, ground=GroundLook(brightness=0.5), drive=DB18_DRIVE)
    pool = LookPool([LOOP], [NOMINAL, dark], np.random.default_rng(0))
    rng = np.random.default_rng(0)
    seen = {pool.draw(0, rng) for _ in range(20)}
    assert seen == {(0, NOMINAL), (1, dark)}


def test_with_a_sampler_paint_is_shared_and_the_rest_is_drawn_anew() -> None:
    pool = LookPool([LOOP, LOOP], load_look_sampler("randomised"), np.random.default_rng(0), 2)
    rng = np.random.default_rng(0)
    assert len(pool.worlds) == 4
    draws = [pool.draw(1, rng) for _ in range(12)]
    assert {index for index, _ in draws} == {2, 3}
    assert len({look.drive for _, look in draws}) == 12
    for index, look in draws:
        painted = pool.worlds[index].look
        assert (look.ground, look.camera) == (painted.ground, painted.camera)


def test_an_episode_is_of_one_site(tmp_path: Path) -> None:
    """Floor, camera, sensor, drive and timing of one file of a folder, in every episode."""
    for k in range(1, 6):
        v = 0.01 * k
        text = f"ground: {{wear: {v}}}\ncamera: {{roll_rad: {v}}}\nsensor: {{vignetting: {v}}}\n"
        text += f"drive: {{trim: {v}}}\ntiming: {{frame_skip: {v}}}\npose: {{outlier: {v}}}\n"
        (tmp_path / f"site_{k}.yaml").write_text(text)
    pool = LookPool([LOOP], load_look_sampler(tmp_path), np.random.default_rng(0), 12)
    rng, seen = np.random.default_rng(1), set()
    for _ in range(60):
        look = pool.draw(0, rng)[1]
        parts = {look.ground.wear, look.camera.roll_rad, look.sensor.vignetting, look.drive.trim}
        assert len(parts | {look.timing.frame_skip, look.pose.outlier}) == 1
        seen |= parts
    assert len(seen) > 2


def test_reality_never_gives_one_site_the_camera_of_another() -> None:
    """Only lab has a narrow lens (focal length from 1.05), and only lab a blue gain below 0.6."""
    pool = LookPool([LOOP], load_look_sampler("reality"), np.random.default_rng(0), 10)
    rng = np.random.default_rng(1)
    looks = [pool.draw(0, rng)[1] for _ in range(80)]
    labs = [look.camera.focal_scale >= 1.05 for look in looks]
    assert labs == [look.sensor.white_balance[2] < 0.6 for look in looks]
    assert 0 < sum(labs) < 80


def test_one_floor_is_painted_once() -> None:
    pool = LookPool([LOOP], load_look_sampler("nominal"), np.random.default_rng(0), 3)
    assert len({id(world.scene.ground) for world in pool.worlds}) == 1


def test_worlds_of_one_seed_share_their_floors_and_leave_none_behind() -> None:
    sampler = load_look_sampler("randomised")
    pools = [LookPool([load_map("loop")], sampler, np.random.default_rng(5), 2) for _ in range(2)]
    first, second = ([id(w.scene.ground) for w in pool.worlds] for pool in pools)
    assert first == second
    other = LookPool([LOOP], sampler, np.random.default_rng(6), 2)
    assert not {id(w.scene.ground) for w in other.worlds} & set(first)
    floor = weakref.ref(pools[0].worlds[0].scene.ground)
    del pools
    gc.collect()
    assert floor() is None


def test_another_seed_paints_other_worlds() -> None:
    sampler = load_look_sampler("randomised")
    each = [DrawnEpisodes([LOOP], sampler, 1, seed, 1) for seed in (3, 3, 4)]
    first, same, other = (episodes.setting(0, 0)[1].look for episodes in each)
    assert first == same
    assert first.ground != other.ground


def test_four_numbered_episodes_of_a_map_share_paint_and_nothing_else() -> None:
    sampler, bean = load_look_sampler("randomised"), load_map("rings/bean")

    def look(number: int, seed: int = 3, maps: int = 1) -> Look:
        episodes = NumberedEpisodes([LOOP, bean][:maps], sampler, 1, seed, [number])
        return episodes.setting(0, number % maps)[2]

    first = look(0)
    assert look(0) == first
    assert look(0, seed=4).ground != first.ground
    assert look(0, seed=4).drive != first.drive
    assert [look(k).ground == first.ground for k in (1, 3, 4)] == [True, True, False]
    assert look(1).drive != first.drive
    both = [look(k, maps=2).ground == first.ground for k in (0, 1, 6, 7, 8)]
    assert both == [True, False, True, False, False]


def test_an_empty_pool_is_refused() -> None:
    with pytest.raises(ConfigError, match="at least one Look"):
        LookPool([LOOP], [], np.random.default_rng(0))


def test_pictures_taken_in_junctions_are_blank_if_asked_for_and_no_others() -> None:
    """To who drives and to who tells where robots are; late ones by where they were taken."""
    arena, look = load_map("arena"), replace(NOMINAL, timing=TimingLook(camera_delay_s=0.2))
    worlds, told = [], []
    for blank in (False, True):
        task, camera = Navigation([arena], 12), PoseCamera(12)
        world = BatchWorld(task, (look,), seed=5, camera=camera, blank_in_junctions=blank)
        world.guidance = Mock(wraps=world.guidance)
        worlds.append(world)
    seen = [world.reset() for world in worlds]
    for _ in range(150):
        places = shown_poses(seen[0].image)[:, :2].tolist()
        inside = np.array([arena.tile_at(*at).is_junction for at in places])  # type: ignore[union-attr]
        np.testing.assert_array_equal(seen[1].image[~inside], seen[0].image[~inside])
        assert seen[0].image.any(axis=(1, 2, 3)).all()
        assert not seen[1].image[inside].any()
        told.append(inside)
        actions = worlds[0].expert_actions()
        steps = [world.step(actions) for world in worlds]
        seen = [step.observation for step in steps]
        if not len(steps[0].finished.robots):
            (to_sight, *_), _ = worlds[1].guidance.see.call_args  # type: ignore[union-attr]
            np.testing.assert_array_equal(to_sight, seen[1].image)
    assert 0.1 < np.mean(told) < 0.9
    for world in worlds:
        world.close()
