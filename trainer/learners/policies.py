"""From a `RunConfig` to the policy that is trained, and what all algorithms are built with."""

from collections.abc import Callable
from typing import Any

from gymnasium import spaces
from stable_baselines3.common.policies import ActorCriticPolicy, BasePolicy
from stable_baselines3.common.vec_env import VecEnv
from torch import nn

from robot.contract import FIVE_ACTIONS
from sim_pybullet import env
from sim_pybullet.tasks.spec import find_task
from trainer.algorithms import Making, find_algorithm
from trainer.config import RunConfig
from trainer.learners.networks import DrivingFeatures, ImitatingPolicy

Schedule = Callable[[float], float]


class ChannelLast:
    """Leaves pictures as (H, W, 3), where stable-baselines3 would copy them to (3, H, W)."""

    @staticmethod
    def _wrap_env(env: Any, *_: Any, **__: Any) -> VecEnv:
        return env


def common_arguments(making: Making) -> dict[str, Any]:
    """What stable-baselines3 is told of every algorithm."""
    config = making.config
    arguments = policy_arguments(config)
    pictures = getattr(making.env, "pictures", None)  # kept on a device, see `PictureStore`
    arguments["features_extractor_kwargs"]["pictures"] = pictures
    return {
        "policy": find_algorithm(config.algorithm).policy,
        "env": making.env,
        "policy_kwargs": arguments,
        "learning_rate": falling(config.learn.learning_rate, config.rate_left),
        "max_grad_norm": config.learn.max_grad_norm,
        "seed": config.seed,
        "device": config.device,
    }


def falling(first: float, least: float) -> Schedule:
    """From the share of the run that is left, 1 to 0: evenly from ``first`` to its share."""
    return lambda left: first * (least + (1.0 - least) * max(left, 0.0))  # the last step overshoots


def build_policy(config: RunConfig) -> BasePolicy:
    """The policy alone, untrained and without an environment, as export and summary need it."""
    arguments = policy_arguments(config)
    actions = spaces.Discrete(len(find_task(config.task).actions))
    arguments["lr_schedule"] = lambda _: config.learn.learning_rate
    # It does not learn, and a first optimiser of torch's imports its compiler, for seconds.
    arguments["optimizer_class"] = lambda *_, **__: None
    return find_algorithm(config.algorithm).policy(observation_space(config), actions, **arguments)


def policy_arguments(config: RunConfig) -> dict[str, Any]:
    """What stable-baselines3 calls ``policy_kwargs``."""
    head, policy = [config.net.head_fc], find_algorithm(config.algorithm).policy
    actor_critic = issubclass(policy, ActorCriticPolicy)
    # in an actor-critic's loss it is multiplied by the weight of the entropy
    share = getattr(config.learn, "entropy", 1.0)
    spec = find_task(config.task)
    imitates = issubclass(policy, ImitatingPolicy)
    hedged = {"hedged": spec.actions} if imitates and spec.actions == FIVE_ACTIONS else {}
    return {
        **hedged,
        "true_path": config.true_path / share if config.true_path else 0.0,
        "features_extractor_class": DrivingFeatures,
        "features_extractor_kwargs": {"net": config.net},
        "net_arch": {"pi": head, "vf": head} if actor_critic else head,
        "activation_fn": nn.ReLU,
        "normalize_images": False,  # the network divides by 255 itself
        "optimizer_kwargs": {"fused": True, "eps": 1e-5 if actor_critic else 1e-8},
    }


def observation_space(config: RunConfig) -> spaces.Space:
    """What the policy of this run sees."""
    (height, width, channels), kind = config.image.shape, find_task(config.task).kind
    told = find_task(config.task).path_points + 2 * config.commands
    return env.observation_space((height, width, channels * kind.frames), told)
