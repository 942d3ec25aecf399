"""The environment of a run, as stable-baselines3 sees it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper
from stable_baselines3.common.vec_env.base_vec_env import VecEnvObs, VecEnvStepReturn

from robot.errors import ConfigError
from robot.inference.translator import Translator, open_translator
from robot.navigation.road_map import RoadMap, load_map
from sim_pybullet.batch import BatchWorld
from sim_pybullet.pool import Looks
from sim_pybullet.racing.track import Track, load_track, mirrored
from sim_pybullet.randomise import load_look_sampler, load_looks
from sim_pybullet.rendering.camera import BatchCamera, NoCamera
from sim_pybullet.scenery.place import Place
from sim_pybullet.tasks.base import Task
from sim_pybullet.tasks.lane_keeping import LaneKeeping
from sim_pybullet.tasks.manoeuvres import Manoeuvres
from sim_pybullet.tasks.navigation import Navigation
from sim_pybullet.tasks.track_racing import STYLES, TrackRacing
from sim_pybullet.vec_env import DuckpilotVecEnv
from trainer.config import RunConfig, choose
from trainer.division import refuse_judging_look, refuse_judging_maps

_TASKS: dict[str, Callable[..., Task]] = {
    "lane": LaneKeeping,
    "navigation": Navigation,
    "four_laps": partial(LaneKeeping, laps=4.0),
    "manoeuvres": Manoeuvres,
    "track": TrackRacing,
}

RINGED = ("lane", "four_laps")  # tasks on rings of road, of which one lane or both are driven

# Worlds of a run, over all maps: a second and 160 MB for eight of them; a track takes some 50 MB.
_PAINTED = {"lane": 48, "navigation": 144, "track": 12}
_FEWEST_LOOKS = 4  # of each map
_STRETCH_OF_A_RING = 0.5  # laps, likewise: more places, looks and bends for as many decisions
_STRETCH_LAPS = 0.08  # of an episode with a spread start, from which most of it is learned


def build_task(name: str, road_maps: Sequence[Place], robots: int, lane: str | None = None) -> Task:
    """The task of that name for so many robots; ``lane``: which of a ring, the outer one if None.

    Raises:
        ConfigError: an unknown name, or a lane for a task that is not to keep one.
        MapError: a map that the task cannot be done on.
    """
    make = choose("task", name, _TASKS)
    if lane is None:
        return make(road_maps, robots)
    if name not in RINGED:
        raise ConfigError(f"lane: expected none for the task {name}, got {lane!r}")
    return partial(make, lane=lane)(road_maps, robots)


def load_places(task: str, names: Sequence[str]) -> list[Place]:
    """The maps of these names, or the tracks where the task drives on tracks.

    Raises:
        DuckpilotError: one that is absent or wrong.
    """
    if task == "track":
        return [load_track(name) for name in names]
    return [load_map(name) for name in names]


def find_looks(task: str, look: str, pose_error: str | None, without: Sequence[str] = ()) -> Looks:
    """A sampler of looks; of a track, whose walls never change, the looks themselves if fixed.

    Raises:
        ConfigError: no such look.
    """
    return (load_looks if task == "track" else load_look_sampler)(look, pose_error, without)


def make_env(config: RunConfig, robots: int, seed: int) -> DuckpilotVecEnv:
    """The world of a run with so many robots; rewards are the task's own.

    Raises:
        DuckpilotError: a map, look or translator that is absent, does not fit, or is kept for
            judging policies.
    """
    translator = open_translator(config.translate, config.image) if config.translate else None
    return DuckpilotVecEnv(_make_world(config, robots, seed, translator=translator))


def make_blind_env(config: RunConfig, robots: int, seed: int) -> DuckpilotVecEnv:
    """As `make_env`, but nothing is drawn: pictures are a black dot.

    Raises:
        DuckpilotError: a map or look that is absent or does not fit.
    """
    return DuckpilotVecEnv(_make_world(config, robots, seed, camera=NoCamera(robots)))


def _make_world(
    config: RunConfig,
    robots: int,
    seed: int,
    camera: BatchCamera | None = None,
    translator: Translator | None = None,
) -> BatchWorld:
    places = load_places(config.task, config.maps)
    refuse_judging_maps(places)
    refuse_judging_look(config.look)
    if config.task == "navigation":
        maps = [place for place in places if isinstance(place, RoadMap)]
        task: Task = Navigation(maps, robots, config.start_spread)
    elif config.task == "track":
        tracks = [place for place in places if isinstance(place, Track)]
        laps = 1.0
        if config.start_spread > 1.0:
            tracks += [mirrored(track) for track in tracks]
            laps = _STRETCH_LAPS
        task = TrackRacing(tracks, robots, laps, STYLES[config.style], config.start_spread)
    else:
        rings = [place for place in places if isinstance(place, RoadMap)]
        laps = 2.0 if config.start_spread == 1.0 else _STRETCH_OF_A_RING
        task = LaneKeeping(rings, robots, config.lane, laps, config.start_spread)
    looks = find_looks(config.task, config.look, config.pose_error, config.without)
    pool_size = max(_PAINTED.get(config.task, 48) // len(task.road_maps), _FEWEST_LOOKS)
    return BatchWorld(task, looks, config.image, seed, pool_size, "planar", camera, translator)


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
