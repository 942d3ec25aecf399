"""The environment of a run, as stable-baselines3 sees it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper
from stable_baselines3.common.vec_env.base_vec_env import VecEnvObs, VecEnvStepReturn

from robot.road_map import RoadMap, load_map
from robot.translator import open_translator
from sim_pybullet.batch import BatchWorld
from sim_pybullet.randomise import load_look_sampler
from sim_pybullet.tasks.base import Task
from sim_pybullet.tasks.lane_keeping import LaneKeeping
from sim_pybullet.tasks.manoeuvres import Manoeuvres
from sim_pybullet.tasks.navigation import Navigation
from sim_pybullet.vec_env import DuckpilotVecEnv
from trainer.config import RunConfig, choose

_TASKS: dict[str, Callable[[Sequence[RoadMap], int], Task]] = {
    "lane": LaneKeeping,
    "navigation": Navigation,
    "four_laps": partial(LaneKeeping, laps=4.0),
    "manoeuvres": Manoeuvres,
}


# Worlds of a run, over all maps: a second and 160 MB for eight of them.
_PAINTED = {"lane": 48, "navigation": 144}
_FEWEST_LOOKS = 4  # of each map


def build_task(name: str, road_maps: Sequence[RoadMap], robots: int) -> Task:
    """The task of that name for so many robots.

    Raises:
        ConfigError: an unknown name.
        MapError: a map that the task cannot be done on.
    """
    return choose("task", name, _TASKS)(road_maps, robots)


def make_env(config: RunConfig, robots: int, seed: int) -> DuckpilotVecEnv:
    """The world of a run with so many robots; rewards are the task's own.

    Raises:
        DuckpilotError: a map, look or translator that is absent or does not fit.
    """
    translator = open_translator(config.translate, config.image) if config.translate else None
    road_maps = [load_map(name) for name in config.maps]
    if config.task == "navigation":
        task: Task = Navigation(road_maps, robots, config.start_spread)
    else:
        task = build_task(config.task, road_maps, robots)
    looks = load_look_sampler(config.look, config.pose_error, config.without)
    pool_size = max(_PAINTED.get(config.task, 48) // len(road_maps), _FEWEST_LOOKS)
    world = BatchWorld(task, looks, config.image, seed, pool_size, translator=translator)
    return DuckpilotVecEnv(world)


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
