"""The environment of a run, as stable-baselines3 and what learns there see it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

import numpy as np
from gymnasium import spaces
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper
from stable_baselines3.common.vec_env.base_vec_env import VecEnvObs, VecEnvStepReturn

from robot.contract import PATH_POINTS
from robot.inference.translator import open_translator
from robot.navigation.guidance import path_inputs
from sim_pybullet.batch import BatchWorld
from sim_pybullet.rendering.camera import BatchCamera
from sim_pybullet.tasks.spec import Choices, find_task
from sim_pybullet.vec_env import DuckpilotVecEnv
from trainer.algorithms import EnvMaker
from trainer.config import RunConfig
from trainer.division import refuse_judging_look, refuse_judging_maps
from trainer.relit import relit

TRUE_PATH = "true_path"
_FEWEST_LOOKS = 4  # of each map


def make_env(
    config: RunConfig, robots: int, seed: int, camera: BatchCamera | None = None
) -> DuckpilotVecEnv:
    """The world of a run with so many robots; rewards are the task's own.

    DuckpilotError for a map, look or translator that is absent, does not fit, or is for judging.
    """
    spec, image = find_task(config.task), config.image
    places = [spec.load(name) for name in config.maps]
    refuse_judging_maps(places)
    refuse_judging_look(config.look)
    lane, style = config.lane if spec.lanes else None, config.style if spec.styles else None
    task = spec.build(places, robots, Choices(lane, style, start_spread=config.start_spread))
    looks = spec.looks(config.look, config.pose_error, config.without)
    pool_size = max(spec.painted // len(task.road_maps), _FEWEST_LOOKS)
    translator = open_translator(config.translate, image) if config.translate else None
    return DuckpilotVecEnv(BatchWorld(task, looks, image, seed, pool_size, camera, translator))


def parts_of(observation: Any) -> dict[str, np.ndarray]:
    """What robots see, by name; of pictures alone ``image``."""
    return dict(observation) if isinstance(observation, dict) else {"image": observation}


class SeenOtherwise(VecEnvWrapper):
    """Robots see what a function makes of what their environment shows.

    Args:
        env: the environment.
        see: of what all robots see and None, or of what a robot saw last in an episode that has
            ended, and its number.
        space: of what comes of it, if it is another.
    """

    def __init__(
        self, env: VecEnv, see: Callable[[Any, int | None], Any], space: spaces.Space | None = None
    ) -> None:
        super().__init__(env, space)
        self._see = see

    def reset(self) -> VecEnvObs:
        """Seen otherwise."""
        return self._see(self.venv.reset(), None)

    def step_wait(self) -> VecEnvStepReturn:
        """Seen otherwise."""
        seen, rewards, done, infos = self.venv.step_wait()
        for i in np.flatnonzero(done).tolist():
            infos[i]["terminal_observation"] = self._see(infos[i]["terminal_observation"], i)
        return self._see(seen, None), rewards, done, infos


def with_true_path(env: VecEnv) -> SeenOtherwise:
    """Adds ``true_path``, the path inputs (PATH_POINTS,) of true poses, to what N robots see.

    An auxiliary task for navigation, after Jaderberg et al. 2017 ("Reinforcement Learning with
    Unsupervised Auxiliary Tasks"). Reward says little of where on its lane a robot is: a wrong
    decision costs next to nothing. So while it learns, a network also says that path, from the
    layer that its choice is made of, and the picture soon corrects the path that comes of a wrong
    pose. Nothing of it is in what is exported. See `robot.navigation.guidance`.
    """
    world, space = cast(DuckpilotVecEnv, env).world, env.observation_space
    parts = space.spaces if isinstance(space, spaces.Dict) else {"image": space}

    def see(seen: Any, robot: int | None) -> dict[str, np.ndarray]:
        true = np.zeros(PATH_POINTS, np.float32)  # of an ended episode: nobody learns from it
        if robot is None:
            true = path_inputs(world.task.paths, world.poses, world.task.course.arc_m)
        return {**parts_of(seen), TRUE_PATH: true}

    true_path = spaces.Box(-1.0, 1.0, (PATH_POINTS,), np.float32)
    return SeenOtherwise(env, see, spaces.Dict({**parts, TRUE_PATH: true_path}))


def under_other_lights(env: VecEnv, rng: np.random.Generator) -> SeenOtherwise:
    """Whatever a robot sees, it sees under a light of its own: one for all frames of a stack.

    Pictures are (H, W, 3 F) uint8, or a dict with them as ``image``.
    """

    def see(seen: Any, robot: int | None) -> Any:
        shown = parts_of(seen)["image"]
        lit = np.stack([relit(each, rng) for each in shown]) if robot is None else relit(shown, rng)
        return {**seen, "image": lit} if isinstance(seen, dict) else lit

    return SeenOtherwise(env, see)


class ScaledReward(VecEnvWrapper):
    """Multiplies rewards, so that values lie near 1, where losses and gradients are made for."""

    def __init__(self, env: VecEnv, scale: float) -> None:
        super().__init__(env)
        self._scale = scale

    def reset(self) -> VecEnvObs:
        """As of the environment."""
        return self.venv.reset()

    def step_wait(self) -> VecEnvStepReturn:
        """As of the environment, the rewards (N,) scaled."""
        observation, rewards, done, infos = self.venv.step_wait()
        return observation, rewards * self._scale, done, infos


def learning_world(config: RunConfig, make_env: EnvMaker) -> VecEnv:
    """Of so many robots as learn at once, as they see it; DuckpilotError as of ``make_env``."""
    env = make_env(config, config.learn.robots, config.seed)
    if config.true_path:
        env = with_true_path(env)
    if config.relit:
        env = under_other_lights(env, np.random.default_rng(config.seed))
    return ScaledReward(env, config.reward_scale)
