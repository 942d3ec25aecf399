"""What environments offer beside five actions: wheel speeds, chosen starts, windows, batches."""

from collections.abc import Iterator
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env as check_gymnasium
from gymnasium.wrappers.vector import RecordEpisodeStatistics
from stable_baselines3 import SAC
from stable_baselines3.common.env_checker import check_env as check_sb3

import sim_pybullet  # noqa: F401  (registers the environments)
from robot.contract import ImageSpec
from robot.errors import ContractError, DuckpilotError
from robot.geometry import bezier_points, bezier_tangents
from robot.navigation.path import lane_loop
from robot.navigation.road_map import load_map

SMALL = ImageSpec(48, 36)
LANE, MISSION, RACE = (f"duckpilot/{n}-v0" for n in ("LaneKeeping", "Navigation", "TrackRacing"))
STRAIGHT, FULL = 0.30, 0.3459  # m/s: both wheels of the action STRAIGHT, the greatest of a wheel


def make(name: str, **arguments: Any) -> gymnasium.Env[Any, Any]:
    return gymnasium.make(name, image=SMALL, pool_size=1, **arguments)


def on_the_lane(arc_m: float = 0.4) -> tuple[float, float, float]:
    pose = lane_loop(load_map("loop")).pose_at(arc_m)
    return pose.x_m, pose.y_m, pose.heading_rad


@pytest.fixture(params=[LANE, MISSION, RACE])
def wheels(request: pytest.FixtureRequest) -> Iterator[gymnasium.Env[Any, Any]]:
    made = make(request.param, continuous=True)
    yield made
    made.close()


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_continuous_environments_pass_the_checkers(wheels: gymnasium.Env[Any, Any]) -> None:
    assert wheels.action_space == gymnasium.spaces.Box(-1.0, 1.0, (2,), np.float32)
    check_gymnasium(wheels.unwrapped, skip_render_check=True)
    check_sb3(wheels.unwrapped)


def test_wheel_speeds_drive_as_the_action_of_the_same_speeds() -> None:
    rewards = []
    for continuous, action in ((False, 2), (True, np.full(2, STRAIGHT / FULL, np.float32))):
        env = make(LANE, continuous=continuous)
        env.reset(seed=3)
        rewards.append([env.step(action)[1] for _ in range(5)])
        env.close()
    np.testing.assert_allclose(rewards[0], rewards[1], atol=1e-3)


@pytest.mark.parametrize("wrong", [[2.0, 0.0], [np.nan, 0.0], [0.1, 0.1, 0.1]])
def test_speeds_beyond_the_wheels_are_refused(wrong: list[float]) -> None:
    env = make(LANE, continuous=True).unwrapped
    env.reset(seed=0)
    with pytest.raises(ContractError, match="from -1 to 1"):
        env.step(np.array(wrong))
    env.close()


def test_sac_learns_on_wheel_speeds() -> None:
    env = make(LANE, continuous=True)
    model = SAC("CnnPolicy", env, buffer_size=64, learning_starts=8, batch_size=4, seed=0)
    model.learn(12)
    assert model.num_timesteps == 12
    env.close()


@pytest.mark.parametrize(("name", "road"), [(LANE, "loop"), (MISSION, "arena")])
def test_an_episode_begins_where_it_is_told(name: str, road: str) -> None:
    env = make(name).unwrapped
    pose = on_the_lane() if road == "loop" else tuple(_somewhere(road))
    seen = [env.reset(seed=seed, options={"pose": pose})[0] for seed in (0, 0)]
    np.testing.assert_allclose(env.world.poses[0], pose, atol=1e-9)
    first, second = (s["image"] if isinstance(s, dict) else s for s in seen)
    np.testing.assert_array_equal(first, second)
    _, _, terminated, _, info = env.step(2)
    assert not terminated
    assert abs(info["offset_m"]) < 0.02
    env.reset(seed=1)
    assert np.linalg.norm(env.world.poses[0, :2] - pose[:2]) > 0.02, "else anywhere"
    env.close()


def _somewhere(road: str) -> np.ndarray:
    lane, begin = load_map(road).lanes[0].control_points_m, np.array([0.2])
    along = bezier_tangents(lane, begin)[0]
    return np.array([*bezier_points(lane, begin)[0], np.arctan2(along[1], along[0])])


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"speed": 3}, "but 'pose'"),
        ({"pose": "here"}, "x \\[m\\], y \\[m\\] and heading"),
        ({"pose": (0.1, float("nan"), 0.0)}, "x \\[m\\], y \\[m\\] and heading"),
        ({"pose": (-5.0, -5.0, 0.0)}, "such as"),
    ],
)
def test_other_options_say_what_is_possible(options: dict[str, Any], said: str) -> None:
    env = make(LANE).unwrapped
    with pytest.raises(DuckpilotError, match=said):
        env.reset(options=options)
    env.close()


def test_a_mission_does_not_begin_off_the_road() -> None:
    env = make(MISSION).unwrapped
    with pytest.raises(DuckpilotError, match="expected the start on the road"):
        env.reset(options={"pose": (-5.0, 0.0, 0.0)})
    env.close()


def test_a_person_sees_what_the_robot_sees(monkeypatch: pytest.MonkeyPatch) -> None:
    """On a screen that is none: the picture in the window is the robot's last."""
    import matplotlib.pyplot as plt

    env = make(LANE, render_mode="human")
    observation, _ = env.reset(seed=0)
    np.testing.assert_array_equal(
        plt.figure("duckpilot").axes[0].images[0].get_array(), observation
    )
    observation, *_ = env.step(2)
    np.testing.assert_array_equal(
        plt.figure("duckpilot").axes[0].images[0].get_array(), observation
    )
    assert env.render() is None
    env.close()
    assert not plt.fignum_exists("duckpilot")


def test_a_vector_environment_is_made_by_its_id_and_keeps_gymnasiums_manners() -> None:
    env = gymnasium.make_vec(LANE, num_envs=5, image=SMALL, pool_size=1, render_mode="rgb_array")
    assert env.metadata["autoreset_mode"] == gymnasium.vector.AutoresetMode.SAME_STEP
    counted = RecordEpisodeStatistics(env)
    seen, _ = counted.reset(seed=4)
    again, _ = counted.reset(seed=4)
    np.testing.assert_array_equal(seen, again)
    assert seen in env.observation_space
    ends = 0
    for _ in range(60):
        seen, rewards, terminated, truncated, infos = counted.step(np.full(5, 1))
        assert seen in env.observation_space
        assert rewards.shape == terminated.shape == truncated.shape == (5,)
        ended = terminated | truncated
        if ended.any():
            np.testing.assert_array_equal(infos["_final_obs"], ended)
            for i in np.flatnonzero(ended):
                assert infos["final_obs"][i] in env.single_observation_space
                assert not np.array_equal(infos["final_obs"][i], seen[i])
            assert infos["final_info"]["drive"]["survival_time_s"][ended].min() > 0.0
        ends += int(ended.sum())
    assert ends >= 5
    pictures = env.render()
    assert pictures is not None
    np.testing.assert_array_equal(pictures[2], seen[2])
    counted.close()


def test_robots_of_a_vector_environment_begin_where_they_are_told() -> None:
    env = gymnasium.make_vec(LANE, num_envs=2, image=SMALL, pool_size=1, continuous=True)
    poses = np.array([on_the_lane(0.2), on_the_lane(0.8)])
    env.reset(seed=0, options={"pose": poses})
    np.testing.assert_allclose(env.unwrapped.world.poses, poses, atol=1e-9)
    env.step(np.zeros((2, 2), np.float32))
    env.close()
