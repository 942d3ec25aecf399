"""The AI Driving Olympics' challenges: who drives, episode by episode, and how each went."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from robot.contract import CONTROL_DT_S
from robot.errors import ConfigError
from robot.navigation.road_map import RoadMap, load_map
from robot.vision.sight import OnnxSight
from sim_pybullet.batch import BatchWorld
from sim_pybullet.episodes import Looks
from sim_pybullet.randomise import load_look_sampler
from sim_pybullet.tasks.spec import Choices, find_task
from sim_pybullet.tasks.traffic import EPISODE_S, Traffic
from sim_pybullet.traffic.crowd import Body
from sim_pybullet.traffic.scenario import load_scenario
from trainer.judging import evaluate
from trainer.judging.cli import JudgeOptions
from trainer.judging.drivers import Driver, Expert, Governed, Pilot, Sighted, Together
from trainer.judging.evaluate import open_policy
from trainer.judging.films import Scene
from trainer.judging.olympics import SURVIVED, Episode, LaneRules, longest_wait_s
from trainer.sight.cli import SHIPPED

BARE = "bare"
_FIRST_WORLD = 1_000_000_009  # seed of all worlds


def drive(
    driver: Driver,
    challenge: str,
    road_maps: Sequence[RoadMap],
    looks: Looks,
    seeds: Sequence[int],
    seconds: float = EPISODE_S,
    films: bool = True,
) -> Iterator[tuple[Episode, Scene | None]]:
    """One episode of so many seconds for each seed, of all robots of ours that share a world.

    All begin at once. They come as each ends, with ``films`` of what the robot saw at its end.
    Consecutive seeds take the maps in turn. MapError for a map without room for the challenge.
    """
    group = len(load_scenario(challenge).robots_pcs)
    spec = find_task("traffic_junctions" if driver.guided else "traffic")
    task = spec.build(road_maps, group * len(seeds), Choices(scenario=challenge))
    assert isinstance(task, Traffic)
    task.frames, task.episode_s, sources = driver.frames, seconds, driver.sources
    numbers = [group * seed + k for seed in seeds for k in range(group)]
    first = task, looks, driver.image, _FIRST_WORLD
    world = BatchWorld(*first, numbers=numbers, sources=sources, commands=driver.commands)
    rules = {road_map.name: LaneRules(road_map) for road_map in road_maps}
    for done, facts, ride in evaluate.drive(world, lambda seen: driver.choose(world, seen), films):
        poses, end = np.array(ride.poses), SURVIVED
        if done.failed:
            hit = int(facts["hit"])
            end = f"collision_{Body(hit).name.lower()}" if hit else "out_of_tile"
        lanes = rules[done.map]
        figures = lanes.figures(poses, CONTROL_DT_S)
        how = end, bool(facts["at_fault"]), done.success, facts["least_ttc_s"]
        waited_s, run = longest_wait_s(poses, CONTROL_DT_S), lanes.lines_run(poses, CONTROL_DT_S)
        tiles = figures.driven_lanedir_consec / lanes.tile_size_m
        seed, robot = divmod(done.seed, group)
        episode = Episode(seed, robot, *how, waited_s, done.map, run, tiles, figures)
        title = f"Episode {episode.seed} on {episode.map} - {end} - {episode.tiles:.1f} tiles"
        yield episode, (episode.badness, title, tuple(ride.frames)) if films else None


@dataclass(frozen=True)
class Contest:
    """A driver in a challenge, see `trainer.judging.blocks.Order`."""

    name: str  # of the driver: a policy's file, expert or stand, or `BARE`
    asked: JudgeOptions  # with maps; ``model`` is the policy that is bare
    films: bool

    @property
    def files(self) -> list[str]:
        """See `trainer.judging.blocks.Order`."""
        return [self.name, self.asked.model, self.asked.look, *self.asked.map]

    def drive(self, seeds: Sequence[int]) -> Iterator[tuple[Episode, Scene | None]]:
        """See `trainer.judging.blocks.Order`."""
        asked = self.asked
        looks = load_look_sampler(asked.look, "none" if asked.poses == "true" else "arena")
        where = asked.challenge, list(map(load_map, asked.map)), looks
        return drive(self.driver(), *where, seeds, asked.seconds, self.films)

    def driver(self) -> Driver:
        """Who drives; DuckpilotError unless it can."""
        model, poses = self.asked.model, self.asked.poses
        if self.name in ("expert", "stand"):
            return Expert() if self.name == "expert" else Driver()
        bare = self.name == BARE and self.name != model
        path = Path(model if bare else self.name)
        if not path.exists():
            others = "" if bare else ", expert or stand"
            raise ConfigError(f"{path}: expected a policy, .onnx{others}; no such file")
        policy = open_policy(path, "lane")
        if bare or poses != "sight":
            return Pilot(policy) if bare else Governed(policy, poses)
        if policy.contract.path_points:
            return Together(policy, OnnxSight(SHIPPED))
        if self.asked.challenge == "lfvi":
            raise ConfigError(f"{path}: expected a navigator, to know its junctions by sight")
        return Sighted(policy, OnnxSight(SHIPPED))
