from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from gymnasium import spaces
from stable_baselines3.common.logger import configure

from robot.contract import PATH_POINTS
from sim_pybullet.vec_env import DuckpilotVecEnv
from tests.trainer.toy import build_model
from trainer.algorithms import find_algorithm
from trainer.config import RunConfig
from trainer.envs import SeenOtherwise, make_env
from trainer.learners.networks import DrivingActorCritic, GreedyNetwork, QPolicy
from trainer.learners.policies import build_policy, policy_arguments
from trainer.learners.world import TRUE_PATH, with_true_path
from trainer.presets import preset

ROBOTS = 3


def run(algorithm: str, pose_error: str) -> RunConfig:
    config = preset("navigation", algorithm, "debug")
    return RunConfig(**{**vars(config), "pose_error": pose_error})


def world(pose_error: str) -> SeenOtherwise:
    return with_true_path(make_env(run("dueling", pose_error), ROBOTS, seed=4))


@pytest.mark.parametrize("pose_error", ["none", "arena"])
def test_is_the_path_input_of_the_true_pose(pose_error: str) -> None:
    env = world(pose_error)
    seen = env.reset()
    assert isinstance(seen, dict)
    assert env.observation_space.contains({name: part[0] for name, part in seen.items()})
    ended, errors = 0, []
    for _ in range(120):
        seen, _, done, infos = env.step(np.zeros(ROBOTS, dtype=int))
        assert isinstance(seen, dict)
        errors.append(np.abs(seen[TRUE_PATH] - seen["path"]).max(axis=1))
        for i in np.flatnonzero(done):
            last = infos[i]["terminal_observation"]
            assert isinstance(env.observation_space, spaces.Dict)
            assert env.observation_space.contains(last)
            ended += 1
    assert ended, "turning in circles ends an episode"
    typical = float(np.median(errors))
    assert typical < 1e-5 if pose_error == "none" else typical > 0.05
    env.close()


@pytest.mark.parametrize("algorithm", ["dueling", "ddqn", "a2c", "ppo"])
def test_is_learned_and_then_left_behind(algorithm: str, tmp_path: Path) -> None:
    config = run(algorithm, "arena")
    env = with_true_path(make_env(config, config.learn.robots, seed=1))
    model = build_model(config, env, tmp_path / "replay")
    head = [value for name, value in model.policy.named_parameters() if "path_head" in name]
    before = [value.detach().clone() for value in head]
    model.learn(200)
    assert any(not torch.equal(a, b) for a, b in zip(before, head, strict=True))
    greedy = GreedyNetwork(model.policy)
    assert not any("path_head" in name for name, _ in greedy.named_parameters())
    build_policy(config).load_state_dict(model.policy.state_dict())
    env.close()


def test_who_has_pictures_only_learns_the_path_as_well(tmp_path: Path) -> None:
    config = replace(preset("track", "ppo", "debug"), true_path=1.0)
    env = with_true_path(make_env(config, config.learn.robots, seed=1))
    assert isinstance(env.observation_space, spaces.Dict)
    assert set(env.observation_space.spaces) == {"image", TRUE_PATH}
    model = build_model(config, env, tmp_path / "replay")
    assert isinstance(model.policy, DrivingActorCritic)
    before = model.policy.path_head.weight.detach().clone()
    model.learn(200)
    env.close()
    assert not torch.equal(before, model.policy.path_head.weight)
    alone = build_policy(config)
    alone.load_state_dict(model.policy.state_dict())
    pictures = torch.zeros(2, *env.observation_space["image"].shape, dtype=torch.uint8)
    assert GreedyNetwork(alone)(pictures).shape == (2, 9)


def test_without_weight_there_is_no_such_task() -> None:
    policy = build_policy(preset("lane", "dueling", "debug"))
    assert isinstance(policy, QPolicy)
    assert not any("path_head" in name for name, _ in policy.named_parameters())
    image = torch.zeros(2, *preset("lane", "dueling", "debug").image.shape, dtype=torch.uint8)
    values, loss = policy.values_and_path_loss(image)
    assert values.shape == (2, 5)
    assert loss == 0.0


def test_loss_is_none_where_the_head_is_right() -> None:
    config = run("dueling", "arena")
    env = world("arena")
    arguments = policy_arguments(config)
    space, actions = env.observation_space, spaces.Discrete(5)
    policy = find_algorithm(config.algorithm).policy(space, actions, lambda _: 1e-3, **arguments)
    env.close()
    assert isinstance(policy, QPolicy)
    head = policy.q_net.path_head
    assert isinstance(head, torch.nn.Linear)
    torch.nn.init.zeros_(head.weight)
    torch.nn.init.constant_(head.bias, 0.25)
    seen = {
        "image": torch.zeros(2, *config.image.shape, dtype=torch.uint8),
        "path": torch.zeros(2, PATH_POINTS),
        TRUE_PATH: torch.full((2, PATH_POINTS), 0.25),
    }
    assert policy.values_and_path_loss(seen)[1] == 0.0
    seen[TRUE_PATH] += 0.5
    loss = policy.values_and_path_loss(seen)[1]
    assert loss.item() == pytest.approx(0.25 * config.true_path)


def test_wraps_the_worlds_of_the_simulator() -> None:
    env = make_env(run("ppo", "none"), ROBOTS, seed=0)
    assert isinstance(env, DuckpilotVecEnv)
    wrapped = with_true_path(env)
    assert wrapped.num_envs == ROBOTS
    wrapped.close()


@pytest.mark.parametrize("algorithm", ["ppo", "a2c"])
def test_entropy_and_path_loss_are_logged_apart(algorithm: str, tmp_path: Path) -> None:
    """An entropy lies between 0 and that of a draw by lot, whatever the path's loss is."""
    config = run(algorithm, "arena")
    env = with_true_path(make_env(config, config.learn.robots, seed=1))
    model = build_model(config, env, tmp_path / "replay")
    assert isinstance(model.policy, DrivingActorCritic)
    torch.nn.init.constant_(model.policy.path_head.bias, 30.0)
    torch.nn.init.zeros_(model.policy.path_head.weight)
    model.set_logger(configure(None, []))
    logged: dict[str, float] = {}
    model.logger.record = lambda name, value, *_, **__: logged.update({name: value})  # type: ignore[method-assign]
    model.learn(config.learn.robots * 100, log_interval=None)
    env.close()
    assert -np.log(5) <= logged["train/entropy_loss"] < 0.0
    assert logged["train/path_loss"] > 100.0
