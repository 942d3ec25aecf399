"""A coach: reinforcement that is told the true path, for DAgger to imitate from pictures.

PPO on the path ahead and the speed takes half a minute where pictures take many. Its choices then
teach a policy that has pictures only (Zhang et al. 2021, "End-to-End Urban Driving by Imitating a
Reinforcement Learning Coach"). Nothing but the task's reward says what is right.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from rich.console import Console
from stable_baselines3 import PPO
from stable_baselines3.common.policies import ActorCriticPolicy

from robot.contract import PATH_POINTS
from robot.navigation.path import path_inputs
from sim_pybullet.batch import BatchWorld
from sim_pybullet.rendering.ray_camera import NoCamera
from sim_pybullet.vec_env import DuckpilotVecEnv
from trainer.config import RunConfig
from trainer.envs import SeenOtherwise, make_env
from trainer.run import atomically
from trainer.torch_file import reading

ROBOTS = 32
GAMMA = 0.9  # a second ahead is enough to stay on a road
_SPEED_MPS = 0.5  # of the world, that speeds are told in


def told(world: BatchWorld) -> np.ndarray:
    """What a coach knows of N robots: (N, PATH_POINTS + 1 + 2 K) path inputs of true poses, speed,
    and the last commands.
    """
    task = world.task
    path = path_inputs(task.paths, world.poses, task.course.arc_m)
    speed = task.vehicle.counted[:, :1] / _SPEED_MPS
    return np.concatenate((path, speed, world.commands), 1).astype(np.float32)


def told_instead(env: DuckpilotVecEnv, reward_scale: float = 1.0) -> SeenOtherwise:
    """Robots that are told what a coach knows; when an episode ends, already of the next one."""
    world, many = env.world, PATH_POINTS + 1 + env.world.commands.shape[1]
    space = spaces.Box(-np.inf, np.inf, (many,), np.float32)
    return SeenOtherwise(
        env, lambda _, k: told(world) if k is None else told(world)[k], space, reward_scale
    )


def find_coach(path: Path, config: RunConfig, steps: int, console: Console) -> ActorCriticPolicy:
    """The coach in this file, taught so many decisions if there is none; it sees what is `told`."""
    if not path.exists():
        policy = _teach(config, steps, console)
        with atomically(path) as temporary:
            policy.save(str(temporary))
    with reading(path, "the coach of this run", "; delete it, and it is taught again"):
        return ActorCriticPolicy.load(str(path), device="cpu")


def _teach(config: RunConfig, steps: int, console: Console) -> ActorCriticPolicy:
    blind = make_env(replace(config, translate=None), ROBOTS, config.seed, NoCamera())
    env = told_instead(blind, config.reward_scale)
    how: dict[str, Any] = {"n_steps": 128, "batch_size": 512, "n_epochs": 5, "gamma": GAMMA}
    how |= {"learning_rate": 1e-3, "ent_coef": 0.02, "seed": config.seed, "device": "cpu"}
    net = {"net_arch": [64, 64], "activation_fn": torch.nn.Tanh}
    model = PPO("MlpPolicy", env, policy_kwargs=net, **how)
    with console.status(f"teaching a coach for {steps:,} decisions"):
        model.learn(steps)
    env.close()
    return model.policy
