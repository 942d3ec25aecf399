"""One contract for every registered environment, and the vector environment's own."""

import subprocess
import sys
from collections.abc import Iterator
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env as check_gymnasium
from stable_baselines3 import PPO
from stable_baselines3.common.env_checker import check_env as check_sb3

from robot.contract import ACTION_TWISTS, ACTION_WHEELS, Action, ImageSpec
from robot.errors import ConfigError
from robot.navigation.navigator import ARRIVAL_M
from robot.navigation.road_map import load_map
from sim_pybullet.batch import BatchWorld
from sim_pybullet.env import DriveEnv, DriveVectorEnv
from sim_pybullet.look import NOMINAL
from sim_pybullet.tasks.lane_keeping import LaneKeeping
from sim_pybullet.tasks.spec import TASKS
from sim_pybullet.tasks.track_racing import RACING_ACTIONS, TrackRacing
from sim_pybullet.vec_env import DuckpilotVecEnv

SMALL = ImageSpec(40, 30, 10)
LAPS = 0.25  # two take too long for a test
IDS = sorted(f"duckpilot/{name}" for spec in TASKS.values() for name in spec.environments)


@pytest.fixture(scope="module", params=IDS)
def env(request: pytest.FixtureRequest) -> Iterator[DriveEnv]:
    lapless = ("Navigation", "Traffic")
    short: dict[str, Any] = {} if any(n in request.param for n in lapless) else {"laps": LAPS}
    if "Track" in request.param:
        short["road_map"] = "karting"
    made = gymnasium.make(request.param, image=SMALL, pool_size=2, render_mode="rgb_array", **short)
    yield made.unwrapped
    made.close()


def drive(env: DriveEnv, seed: int, actions: list[int]) -> list[tuple[Any, ...]]:
    """Everything that reset and steps gave, until the episode ended."""
    steps: list[tuple[Any, ...]] = [(env.reset(seed=seed)[0], 0.0, False, False, {})]
    for action in actions:
        steps.append(env.step(action))
        if steps[-1][2] or steps[-1][3]:
            break
    return steps


def parts(observation: Any) -> list[np.ndarray]:
    """The arrays of an observation, the picture first."""
    return list(observation.values()) if isinstance(observation, dict) else [observation]


def some_actions(count: int) -> list[int]:
    return np.random.default_rng(5).integers(5, size=count).tolist()


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_passes_the_checkers_of_gymnasium_and_stable_baselines3(env: DriveEnv) -> None:
    check_gymnasium(env)
    check_sb3(env)


def test_same_seed_and_actions_give_the_same_drive(env: DriveEnv) -> None:
    first, second = (drive(env, 3, some_actions(25)) for _ in range(2))
    assert len(first) == len(second)
    for a, b in zip(first, second, strict=True):
        for one, other in zip(parts(a[0]), parts(b[0]), strict=True):
            np.testing.assert_array_equal(one, other)
        assert a[1:] == b[1:]


def test_other_seeds_begin_elsewhere(env: DriveEnv) -> None:
    firsts = [parts(env.reset(seed=seed)[0])[0] for seed in range(3)]
    assert not np.array_equal(firsts[0], firsts[1])
    assert not np.array_equal(firsts[1], firsts[2])


def test_observations_share_no_memory(env: DriveEnv) -> None:
    seen = [part for step in drive(env, 0, [2] * 5) for part in parts(step[0])]
    for i, a in enumerate(seen):
        assert not any(np.shares_memory(a, b) for b in seen[i + 1 :])


def test_pictures_change_while_driving(env: DriveEnv) -> None:
    pictures = np.array([parts(step[0])[0] for step in drive(env, 0, some_actions(25))])
    changes = (pictures != pictures[0]).any(axis=(0, -1))
    assert changes.mean() > 0.5


def test_parked_earns_less_than_driving(env: DriveEnv) -> None:
    env.reset(seed=1)
    driving = [env.step(int(env.world.expert_actions()[0]))[1] for _ in range(20)]
    world = env.world
    world.reset()
    here = world.poses
    parked = [world.task.step(here, np.zeros(1, dtype=bool)).reward[0] for _ in range(20)]
    assert sum(parked) <= 0.0 < sum(driving)


def test_leaving_the_lane_terminates_and_is_not_truncated(env: DriveEnv) -> None:
    *_, terminated, truncated, info = drive(env, 0, [Action.STRAIGHT] * 400)[-1]
    assert terminated
    assert not truncated
    assert not info["is_success"]
    assert info["drive"]["survival_time_s"] > 0.0


def test_the_goal_truncates_and_is_a_success(env: DriveEnv) -> None:
    env.reset(seed=2)
    over = False
    while not over:
        _, _, terminated, truncated, info = env.step(int(env.world.expert_actions()[0]))
        over = terminated or truncated
    assert truncated
    assert not terminated
    assert info["is_success"]
    if "tiles" in info:
        assert info["tiles"] >= 3.0
    else:
        assert info["laps"] >= LAPS if "laps" in info else info["remaining_m"] <= ARRIVAL_M


def test_info_explains_the_reward(env: DriveEnv) -> None:
    for _, reward, _, _, info in drive(env, 4, some_actions(10))[1:]:
        assert sum(info["terms"].values()) == pytest.approx(reward)
        names = {"arc_m", "offset_m", "is_success", "collided", *env.world.task.fact_names}
        assert names <= set(info)


def test_actions_are_those_of_the_contract(env: DriveEnv) -> None:
    assert env.action_space == gymnasium.spaces.Discrete(len(env.world.task.vehicle.actions))
    if isinstance(env.world.task, TrackRacing):
        assert env.world.task.vehicle.actions == RACING_ACTIONS
        return
    turns = np.diff(ACTION_WHEELS, axis=1)[:, 0] / 0.102
    np.testing.assert_allclose(turns, [twist.turn_radps for twist in ACTION_TWISTS])
    for name, twist in zip(Action, ACTION_TWISTS, strict=True):
        row = next(
            line for line in (DriveEnv.__doc__ or "").splitlines() if f" {name.name} " in line
        )
        assert [float(w) for w in row.split() if w[-1].isdigit()] == [int(name), *twist]


def test_render_gives_the_last_picture(env: DriveEnv) -> None:
    picture = parts(drive(env, 0, [2, 2])[-1][0])[0]
    np.testing.assert_array_equal(env.render(), picture[..., -3:])


def test_options_are_refused(env: DriveEnv) -> None:
    with pytest.raises(ConfigError, match="no options"):
        env.reset(options={"speed": 3})


def test_unknown_pose_errors_are_refused_with_the_nearest() -> None:
    with pytest.raises(ConfigError, match="'arena'"):
        gymnasium.make("duckpilot/Navigation-v0", pose_error="arina")


def test_importing_the_package_imports_nothing_heavy_and_says_nothing() -> None:
    code = (
        "import sys, sim_pybullet; "
        "print([m for m in ('pybullet', 'torch', 'numba', 'cv2') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == ("[]\n", "")


@pytest.fixture
def vec_env() -> Iterator[DuckpilotVecEnv]:
    made = DuckpilotVecEnv(BatchWorld(LaneKeeping([load_map("loop")], 6), [NOMINAL], SMALL))
    yield made
    made.close()


def test_vector_environment_keeps_the_last_observation(vec_env: DuckpilotVecEnv) -> None:
    vec_env.seed(0)
    before, ends = vec_env.reset(), 0
    for action in some_actions(80):
        observation, reward, done, infos = vec_env.step(np.full(6, action))
        assert not np.shares_memory(observation, before)
        assert observation.shape == (6, *SMALL.shape)
        assert (reward.shape, done.shape, len(infos)) == ((6,), (6,), 6)
        for i in range(6):
            assert ("terminal_observation" in infos[i]) == done[i]
            if done[i]:
                last = infos[i]["terminal_observation"]
                assert vec_env.observation_space.contains(last)
                assert not np.array_equal(last, observation[i])
                assert not infos[i]["TimeLimit.truncated"]
        ends += int(done.sum())
        before = observation
    assert ends > 6


def test_vector_and_single_environment_are_the_same_world() -> None:
    """N = 1: the same seed and actions give the same pictures and rewards."""
    faces: list[Any] = []
    for make in (DriveEnv, DuckpilotVecEnv):
        world = BatchWorld(LaneKeeping([load_map("loop")], 1), [NOMINAL], SMALL)
        faces.append(make(world))
        world.seed(11)
    single, vector = faces
    np.testing.assert_array_equal(single.reset()[0], vector.reset()[0])
    for action in [2, 1, 2, 3, 2]:
        a, b = single.step(action), vector.step(np.array([action]))
        np.testing.assert_array_equal(a[0], b[0][0])
        assert a[1] == pytest.approx(b[1][0], rel=1e-6)
    for face in faces:
        face.close()


@pytest.mark.parametrize("face", [DriveEnv, DriveVectorEnv, DuckpilotVecEnv])
def test_every_face_of_a_world_tells_the_last_commands(face: Any) -> None:
    made = face(BatchWorld(LaneKeeping([load_map("loop")], 1), [NOMINAL], SMALL, commands=5))
    made.reset()
    seen = made.step(1 if face is DriveEnv else np.array([1]))[0]
    assert made.observation_space["path"].shape[-1] == 10
    if face is DriveVectorEnv:
        assert made.observation_space.contains(seen)
    else:
        one = seen if face is DriveEnv else {name: part[0] for name, part in seen.items()}
        assert made.observation_space.contains(one)
    last = seen["path"].flatten()[-2:]
    assert last == pytest.approx((0.2541 / 0.3459, 1.0), abs=1e-4)
    made.close()


def test_stable_baselines3_learns_on_it(vec_env: DuckpilotVecEnv) -> None:
    model = PPO("MlpPolicy", vec_env, n_steps=8, batch_size=16, n_epochs=1, seed=0)
    model.learn(48)
    assert model.num_timesteps == 48


@pytest.mark.parametrize("image", [ImageSpec(84, 84), ImageSpec(96, 96, 32)])
def test_pictures_may_be_of_any_shape(image: ImageSpec) -> None:
    env = gymnasium.make("duckpilot/LaneKeeping-v0", image=image)
    picture, _ = env.reset(seed=0)
    assert picture.shape == image.shape
    env.close()
