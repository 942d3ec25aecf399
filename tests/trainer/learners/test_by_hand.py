"""Layers, workers' books, memory and schedules of the learners, worked out by hand."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch
from gymnasium import spaces
from rich.console import Console
from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm
from stable_baselines3.common.policies import ActorCriticPolicy

from robot.errors import ConfigError
from trainer.learners import coach
from trainer.learners.actor_critic import CRUISE, ActorCriticConfig, FallingEntropy
from trainer.learners.episode_count import EpisodeCount, EpisodeEnd
from trainer.learners.networks import DrivingActorCritic, DrivingFeatures
from trainer.learners.policies import build_policy, falling, observation_space, policy_arguments
from trainer.learners.replay import MappedReplayBuffer
from trainer.presets import preset

ROBOTS = 4


@pytest.mark.parametrize("channels", [(4, 6, 8), (4, 6, 8, 10)])
def test_convolutions_see_eight_pixels_then_four_then_three_then_two(
    channels: tuple[int, ...],
) -> None:
    config = preset("lane", "ddqn", "paper")
    config = replace(config, net=replace(config.net, channels=channels))
    features = policy_of(config).features_extractor
    assert isinstance(features, DrivingFeatures)
    rows = [
        (m.in_channels, m.out_channels, m.kernel_size, m.stride, m.padding)
        for m in features.convolutions
        if isinstance(m, torch.nn.Conv2d)
    ]
    kernels, strides = (8, 4, 3, 2), (4, 2, 1, 1)
    assert rows == [
        (before, after, (kernel,) * 2, (stride,) * 2, (0, 0))
        for before, after, kernel, stride in zip(
            (3, *channels), channels, kernels, strides, strict=False
        )
    ]
    assert [type(m) for m in features.convolutions[1::2]] == [torch.nn.ReLU] * len(channels)


def policy_of(config: Any) -> Any:
    policy = build_policy(config)
    return policy if isinstance(policy, ActorCriticPolicy) else policy.q_net  # type: ignore[attr-defined]


def test_a_path_has_a_branch_of_its_own_beside_the_picture() -> None:
    config = preset("navigation", "ppo", "debug")
    config = replace(config, net=replace(config.net, image_fc=20, path_fc=(6, 9), head_fc=11))
    features = policy_of(config).features_extractor
    assert features.features_dim == 20 + 9
    assert [(m.in_features, m.out_features) for m in features.path_fc[::2]] == [(10, 6), (6, 9)]
    image = torch.randint(0, 256, (2, *config.image.shape), dtype=torch.uint8)
    path = torch.rand(2, 10)
    seen = features({"image": image, "path": path})
    pixels = image.float().permute(0, 3, 1, 2) / 255.0
    looked = features.image_fc(features.convolutions(pixels).flatten(1))
    torch.testing.assert_close(seen[:, :20], looked)
    torch.testing.assert_close(seen[:, 20:], features.path_fc(path))


def test_offsets_begin_at_nothing() -> None:
    for algorithm in ("dueling", "ppo"):
        policy = build_policy(preset("lane", algorithm, "debug"))
        biases = [p for name, p in policy.named_parameters() if name.endswith("bias")]
        assert biases
        assert not any(p.any() for p in biases)


def test_a_process_keeps_the_books_of_its_robots() -> None:
    """The third of four robots each has robots 8 to 11; rewards are told as the task gives them."""
    count, scale = EpisodeCount(ROBOTS, 0.5, 8), 0.5
    nothing: list[dict[str, Any]] = [{} for _ in range(ROBOTS)]
    nobody = np.zeros(ROBOTS, dtype=bool)
    assert count.ended(np.array([1.0, 2.0, 3.0, 4.0]), nobody, nothing) == []
    done = np.array([False, True, False, True])
    infos: list[dict[str, Any]] = [{}, {"is_success": True}, {}, {}]
    ends = count.ended(np.array([1.0, 2.0, 3.0, 5.0]), done, infos)
    assert ends == [EpisodeEnd(9, 4.0 / scale, 2, True), EpisodeEnd(11, 9.0 / scale, 2, False)]
    ends = count.ended(np.full(ROBOTS, 7.0), ~nobody, nothing)
    assert [(end.robot, end.reward, end.length) for end in ends] == [
        *((8, 9.0 / scale, 3), (9, 7.0 / scale, 1)),
        *((10, 13.0 / scale, 3), (11, 7.0 / scale, 1)),
    ]


IMAGE = spaces.Box(0, 255, (2, 2, 3), np.uint8)
BOTH = spaces.Dict({"image": IMAGE, "path": spaces.Box(-1, 1, (5,), np.float32)})


@pytest.mark.parametrize(("space", "row_bytes"), [(IMAGE, 12), (BOTH, 12 + 20)])
def test_a_buffer_asks_for_as_much_disk_as_its_pictures_take_twice(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, space: spaces.Space, row_bytes: int
) -> None:
    """30 transitions of 3 robots are 10 rows: before and after each, every robot's."""
    needed = 2 * row_bytes * 10 * 3
    free = [needed - 1]
    monkeypatch.setattr(shutil, "disk_usage", lambda _: SimpleNamespace(free=free[0]))

    def opened(folder: str) -> MappedReplayBuffer:
        actions = spaces.Discrete(5)
        path = tmp_path / folder
        return MappedReplayBuffer(30, space, actions, n_envs=3, folder=path, n_steps=2, gamma=0.9)

    with pytest.raises(ConfigError, match="GB free under"):
        opened("a")
    free[0] = needed
    assert opened("b").buffer_size == 10
    free[0] = 0
    assert opened("b").taken_over, "what is there already need not be free"


def test_who_drove_when_a_process_died_was_cut_off_and_did_not_fail(tmp_path: Path) -> None:
    def opened() -> MappedReplayBuffer:
        return MappedReplayBuffer(
            30, IMAGE, spaces.Discrete(5), n_envs=3, folder=tmp_path, n_steps=2, gamma=0.9
        )

    buffer, seen = opened(), np.zeros((3, 2, 2, 3), np.uint8)
    done = np.array([True, False, True])
    infos: list[dict[str, Any]] = [{}, {}, {"TimeLimit.truncated": True}]
    for _ in range(2):
        buffer.add(seen, seen, np.ones(3), np.full(3, 2.0), done, infos)
    assert int(buffer.rows[0]) == 2
    again = opened()
    assert again.timeouts[0].tolist() == [0.0, 0.0, 1.0]
    assert again.timeouts[1].tolist() == [0.0, 1.0, 1.0]
    assert again.dones[1].tolist() == [1.0, 0.0, 1.0]
    assert again.rewards[:3].tolist() == [[2.0] * 3] * 3, "the next row was perhaps half written"
    assert (again.pos, again.full, int(again.rows[0])) == (2, False, 2)


def test_entropy_and_the_loss_of_the_path_are_means_since_the_last_time(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    told: list[tuple[str, float]] = []
    monkeypatch.setattr(OnPolicyAlgorithm, "train", lambda _: None)
    model: Any = object.__new__(FallingEntropy)
    model.policy = SimpleNamespace(losses=[])
    model._logger = SimpleNamespace(record=lambda name, value: told.append((name, value)))
    model.entropies, model._current_progress_remaining = lambda left: 3.0 * left, 0.5
    model.train()
    assert (told, model.ent_coef) == ([], 1.5)
    model.policy.losses += [torch.tensor([2.0, 0.6]), torch.tensor([4.0, 1.0])]
    model.train()
    assert [name for name, _ in told] == ["train/entropy_loss", "train/path_loss"]
    assert [value for _, value in told] == pytest.approx([-3.0, 0.8])
    model.train()
    assert len(told) == 2


def test_the_auxiliary_loss_comes_off_the_entropy() -> None:
    config = replace(preset("navigation", "ppo", "debug"), true_path=0.5)
    space = observation_space(config)
    assert isinstance(space, spaces.Dict)
    both = spaces.Dict({**space.spaces, "true_path": spaces.Box(-1.0, 1.0, (10,), np.float32)})
    arguments = policy_arguments(config)
    assert arguments["true_path"] == pytest.approx(0.5 / config.learn.entropy)  # type: ignore[attr-defined]
    policy = DrivingActorCritic(both, spaces.Discrete(5), lambda _: 1e-3, **arguments)
    generator = torch.Generator().manual_seed(0)
    seen = {
        "image": torch.randint(0, 256, (6, *config.image.shape), generator=generator).byte(),
        "path": torch.rand(6, 10, generator=generator),
        "true_path": torch.rand(6, 10, generator=generator),
    }
    actions = torch.tensor([0, 1, 2, 3, 4, 0])
    values, logs, entropy = policy.evaluate_actions(seen, actions)
    latent, _ = policy.mlp_extractor(policy.extract_features(seen))
    chances = policy.action_net(latent).log_softmax(1)
    error = (policy.path_head(latent) - seen["true_path"]).square().mean(1)
    plain = -(chances.exp() * chances).sum(1)
    assert entropy is not None
    torch.testing.assert_close(entropy, plain - policy.true_path * error)
    torch.testing.assert_close(logs, chances[torch.arange(6), actions])
    torch.testing.assert_close(values, policy.predict_values(seen))


def test_what_falls_falls_evenly_to_its_share_and_no_farther() -> None:
    fall = falling(2.0, 0.25)
    assert [fall(left) for left in (1.0, 0.5, 0.0, -0.1)] == [2.0, 1.25, 0.5, 0.5]


def test_the_settings_of_actor_critics() -> None:
    assert CRUISE == {"learn": {"gamma": 0.9, "entropy": 0.02}, "entropy_left": 0.25}
    told = {name: ActorCriticConfig.__dataclass_fields__[name].default for name in SETTINGS}
    assert told == SETTINGS


SETTINGS = {"gamma": 0.95, "entropy": 0.01, "value": 0.5}


def test_how_a_coach_is_taught(monkeypatch: pytest.MonkeyPatch) -> None:
    given: dict[str, Any] = {}

    class Ppo:
        policy = "taught"

        def __init__(self, kind: str, env: Any, **settings: Any) -> None:
            given.update(settings, kind=kind, robots=env.num_envs)

        def learn(self, steps: int) -> None:
            given.update(steps=steps)

    monkeypatch.setattr(coach, "PPO", Ppo)
    config = replace(preset("lane", "coached", "debug"), seed=5)
    assert coach._teach(config, 640, Console(quiet=True)) == "taught"  # type: ignore[comparison-overlap]
    network = given.pop("policy_kwargs")
    assert network == {"net_arch": [64, 64], "activation_fn": torch.nn.Tanh}
    assert given == {
        **{"kind": "MlpPolicy", "robots": 32, "steps": 640, "seed": 5, "device": "cpu"},
        **{"n_steps": 128, "batch_size": 512, "n_epochs": 5, "gamma": 0.9},
        **{"learning_rate": 1e-3, "ent_coef": 0.02},
    }
