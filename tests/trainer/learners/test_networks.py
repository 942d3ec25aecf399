from dataclasses import replace

import numpy as np
import pytest
import torch
from gymnasium import spaces
from stable_baselines3.common.policies import ActorCriticPolicy

from robot.contract import ACTION_TWISTS, PATH_POINTS
from robot.errors import ContractError
from trainer.algorithms import NAMES, find_algorithm
from trainer.config import NetConfig, RunConfig
from trainer.learners.networks import (
    DrivingFeatures,
    DuelingPolicy,
    GreedyNetwork,
    QPolicy,
)
from trainer.learners.policies import build_policy, observation_space, policy_arguments
from trainer.presets import preset

ACTIONS = spaces.Discrete(len(ACTION_TWISTS))
PATH = spaces.Box(-1.0, 1.0, (PATH_POINTS,), np.float32)


def policy_for(config: RunConfig, space: spaces.Space) -> torch.nn.Module:
    return find_algorithm(config.algorithm).policy(
        space, ACTIONS, lambda _: 1e-3, **policy_arguments(config)
    )


def pictures(count: int, config: RunConfig) -> torch.Tensor:
    generator = torch.Generator().manual_seed(0)
    return torch.randint(
        0, 256, (count, *config.image.shape), generator=generator, dtype=torch.uint8
    )


@pytest.mark.parametrize("algorithm", NAMES)
def test_values_for_a_picture_and_for_picture_and_path(algorithm: str) -> None:
    config = replace(preset("lane", algorithm, "debug"), commands=0)
    image = pictures(3, config)
    alone = GreedyNetwork(policy_for(config, observation_space(config)))
    assert alone(image).shape == (3, 5)
    assert torch.equal(alone(image), alone(image.float()))
    both = spaces.Dict({"image": observation_space(config), "path": PATH})
    network = GreedyNetwork(policy_for(config, both))
    left, right = torch.full((3, PATH_POINTS), 0.5), torch.full((3, PATH_POINTS), -0.5)
    assert network(image, left).shape == (3, 5)
    assert not torch.equal(network(image, left), network(image, right))
    assert not torch.equal(network(image, left), network(255 - image, left))


def test_each_picture_of_a_batch_is_seen_alone() -> None:
    config = preset("lane", "dueling", "fast")
    network = GreedyNetwork(policy_for(config, observation_space(config)))
    image = pictures(4, config)
    one_by_one = torch.cat([network(image[i : i + 1]) for i in range(4)])
    torch.testing.assert_close(network(image), one_by_one)


def test_dueling_advantages_have_no_mean() -> None:
    config = preset("lane", "dueling", "debug")
    policy = policy_for(config, observation_space(config))
    assert isinstance(policy, DuelingPolicy)
    features = torch.rand(6, policy.q_net.features_dim)
    value, _ = policy.q_net.q_net
    torch.testing.assert_close(policy.q_net.q_net(features).mean(1, keepdim=True), value(features))


def test_target_network_starts_equal_and_apart() -> None:
    config = preset("lane", "dueling", "debug")
    policy = policy_for(config, observation_space(config))
    assert isinstance(policy, QPolicy)
    pairs = zip(policy.q_net.parameters(), policy.q_net_target.parameters(), strict=True)
    assert all(torch.equal(a, b) and a.data_ptr() != b.data_ptr() for a, b in pairs)


def test_paper_network_has_the_size_of_nature_cnn_plus_its_third_layer() -> None:
    """On 160x120 Nature's three convolutions leave 16x11 of 64 channels."""
    network = GreedyNetwork(build_policy(preset("lane", "ddqn", "paper")))
    convolutions = (32 * 3 * 64 + 32) + (64 * 32 * 16 + 64) + (64 * 64 * 9 + 64)
    connected = (64 * 16 * 11 * 512 + 512) + (512 * 256 + 256) + (256 * 5 + 5)
    assert sum(p.numel() for p in network.parameters()) == convolutions + connected


def test_what_is_no_picture_is_refused() -> None:
    with pytest.raises(ContractError, match="expected a picture"):
        DrivingFeatures(spaces.Box(0, 255, (3, 40, 80), np.uint8), NetConfig())


def test_an_actor_critic_without_entropy_can_be_built() -> None:
    config = preset("lane", "ppo", "debug")
    greedy = replace(config, learn=replace(config.learn, entropy=0.0))
    assert policy_arguments(greedy)["true_path"] == 0.0


@pytest.mark.parametrize("algorithm", ["ppo", "a2c", "a3c"])
def test_a_fresh_critic_expects_next_to_nothing(algorithm: str) -> None:
    """Else what it shares with the actor shrinks first, now and then until nothing is seen."""
    config = preset("lane", algorithm, "debug")
    policy = policy_for(config, observation_space(config))
    assert isinstance(policy, ActorCriticPolicy)
    with torch.no_grad():
        assert policy.predict_values(pictures(3, config)).abs().max() < 0.1


def squares(layer: torch.nn.Module) -> torch.Tensor:
    """Inner products of the rows, or of the columns where these are fewer."""
    assert isinstance(layer, (torch.nn.Conv2d, torch.nn.Linear))
    rows = layer.weight.detach().flatten(1)
    return rows @ rows.T if rows.shape[0] <= rows.shape[1] else rows.T @ rows


def assert_gain(layer: torch.nn.Module, gain: float) -> None:
    seen = squares(layer)
    torch.testing.assert_close(seen, gain**2 * torch.eye(len(seen)), atol=1e-4, rtol=1e-4)


def test_weights_begin_orthogonal_and_those_of_values_smaller() -> None:
    config = preset("lane", "dueling", "fast")
    policy = policy_for(config, observation_space(config))
    assert isinstance(policy, QPolicy)
    value, advantage = policy.q_net.q_net
    for layer in (*policy.q_net.features_extractor.convolutions[::2], advantage[0], value[0][0]):
        assert_gain(layer, 2.0**0.5)
    assert_gain(advantage[-1], 1.0)
    assert_gain(value[1], 1.0)
    config = preset("lane", "ppo", "fast")
    actor_critic = policy_for(config, observation_space(config))
    assert_gain(actor_critic.value_net, 0.01)  # type: ignore[arg-type]
    assert_gain(actor_critic.action_net, 0.01)  # type: ignore[arg-type]


@pytest.mark.parametrize(("centred", "black"), [(False, 0.0), (True, -1.0)])
def test_pixels_enter_from_zero_to_one_or_around_zero(centred: bool, black: float) -> None:
    config = preset("lane", "ppo", "debug")
    config = replace(config, net=replace(config.net, centred=centred))
    features = policy_for(config, observation_space(config)).features_extractor
    assert isinstance(features, DrivingFeatures)
    given: list[torch.Tensor] = []
    features.convolutions.register_forward_pre_hook(lambda _, x: given.append(x[0]))
    for level in (255, 0):
        features(torch.full((1, *config.image.shape), level, dtype=torch.uint8))
    assert given[0].shape == (1, 3, *config.image.shape[:2])
    assert [each.unique().item() for each in given] == [1.0, black]


@pytest.mark.parametrize("name", ["paper", "fast", "debug"])
def test_of_stacked_pictures_only_what_differs_from_grey_is_seen(name: str) -> None:
    config = preset("track", "a2c", name)
    space = observation_space(config)
    torch.manual_seed(0)  # one small network in many is born blind
    policy = policy_for(config, space)
    assert isinstance(policy, ActorCriticPolicy)
    grey = torch.full((1, *(space.shape or ())), 127.5)
    assert torch.count_nonzero(policy.features_extractor(grey)) == 0  # biases begin at 0
    assert torch.count_nonzero(policy.features_extractor(grey + 1.0)) > 0
