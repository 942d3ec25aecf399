"""What the commands ``train`` and ``evaluate`` can be asked for.

To read it, as help does, takes none of what they need: that is imported where it is used.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Self

import tyro

from robot.errors import ConfigError, expect_between
from robot.typed_config import to_plain

if TYPE_CHECKING:
    from trainer.config import RunConfig

MOST_EPISODES = 10_000_000
ZEROS = ("image", "path", "junctions")


@dataclass(frozen=True)
class TrainOptions:
    """How a policy is trained; every name is an option of ``train`` and a key of its matrix."""

    task: str = "lane"  # lane, navigation, traffic or track.
    algo: str = "dueling"  # ddqn, dueling, a2c, a3c, ppo, dagger or coached.
    preset: str = "fast"  # paper, fast or debug.
    map: tuple[str, ...] = ()  # Map or track files, or shipped names or folders; else the task's.
    lane: str = "outer"  # Of a ring, in the task lane: outer, inner (the other way round), or both.
    steps: int | None = None  # Decisions of all robots together; else the preset's.
    seconds: float | None = None  # Stop after so much wall-clock time.
    seed: int = 0  # Of everything random.
    look: str = "nominal"  # A YAML file with a look or a distribution of looks, or a shipped name.
    without: tuple[str, ...] = ()  # What of the look stays nominal, GROUP or GROUP.FIELD.
    pose_error: str | None = None  # none or arena, in place of the look's own.
    translate: str | None = None  # An ONNX translator or parser that every picture passes through.
    backbone: str | None = None  # An ONNX sight by whose layers the policy sees; they stay.
    judge_map: tuple[str, ...] = ()  # Where the policy is chosen, if not on the training's maps.
    judge_look: str = ""  # In which look it is chosen, if not that of the training; untranslated.
    style: str = "race"  # Of the task track: race, or cruise along the road as people do.
    judgings: int | None = None  # How often it is judged at most, evenly spread; else the preset's.
    rate_left: float | None = None  # Share of the learning rate at the end; else the preset's.
    start_spread: float | None = None  # Times as far off its path robots start; else the preset's.
    true_path: float | None = None  # Weight of telling the true path, too; else the preset's.
    device: str | None = None  # Where it draws and learns: cpu, cuda or auto; else the preset's.
    full: bool = False  # Use all the steps, even when the task has been learned.

    def config(self) -> "RunConfig":
        """The run asked for; DuckpilotError for a wrong name, or what is kept for judging."""
        from robot.inference.policy import PARSING, OnnxTranslator
        from sim_pybullet.randomise import load_look_sampler
        from sim_pybullet.tasks.spec import find_task
        from trainer.division import maps_named, refuse_judging_look, refuse_judging_maps
        from trainer.presets import preset

        config = preset(self.task, self.algo, self.preset, self.style)
        maps, judged_on = maps_named(self.map) or config.maps, maps_named(self.judge_map)
        load_look_sampler(self.look, self.pose_error, self.without)
        to_train = maps, self.look, "train"
        for names, look, use in (to_train, (judged_on, self.judge_look or self.look, "choose")):
            refuse_judging_look(look, use)
            refuse_judging_maps([find_task(self.task).load(name) for name in names], use)
        judging = replace(config.evaluation, maps=judged_on, look=self.judge_look)
        if self.judgings is not None:
            expect_between("judgings", self.judgings, 1, 1_000_000)
            judging = replace(judging, every_share=1.0 / self.judgings)
        if self.full:
            judging = replace(judging, stop_after_perfect=0)
        same = ("seed", "lane", "look", "without", "pose_error", "translate")
        else_the_presets = ("steps", "seconds", "rate_left", "start_spread", "true_path", "device")
        given = [name for name in else_the_presets if getattr(self, name) is not None]
        changes = {name: getattr(self, name) for name in (*same, *given)}
        config = replace(config, maps=maps, **changes)
        if self.translate is not None and Path(self.translate).exists():  # else the world says so
            seen = OnnxTranslator(self.translate).contract
            if seen.direction == PARSING:  # whoever sees what a parser sees takes its pictures
                config = replace(config, image=seen.image)
        if self.backbone:
            from robot.vision.sight import OnnxSight

            net = replace(config.net, backbone=self.backbone)
            config = replace(config, net=net, image=OnnxSight(self.backbone).contract.image)
        return replace(config, evaluation=judging)


@dataclass(frozen=True)
class EvaluateOptions:
    """How a policy is judged; every name is an option of ``evaluate`` and a key of its matrix."""

    model: Annotated[str, tyro.conf.arg(metavar="FILE")] = ""  # A policy, .onnx.
    task: str = ""
    """lane, four_laps, hundred_laps, navigation, manoeuvres, traffic, track; else the policy's."""
    map: tuple[str, ...] = ()  # Map or track files, or shipped names or folders; else the task's.
    lane: str | None = None  # Of rings: outer, inner (the other way round) or both, in turn.
    look: str = "nominal"  # A YAML file with a look or a distribution of looks, or a shipped name.
    without: tuple[str, ...] = ()  # What of the look stays nominal, GROUP or GROUP.FIELD.
    pose_error: str | None = None  # none or arena, in place of the look's own.
    translate: str | None = None  # An ONNX translator between preprocessed picture and policy.
    overhead: str = "always"  # When overhead poses come: always, 1-in-20 (seconds) or start.
    sight: str | None = None  # An ONNX sight, which corrects where robots believe to be.
    zero: str | None = None
    """image, path or junctions (pictures taken there, sight's too): zeros for the policy."""
    episodes: int = 100  # How many.
    seed: int = 1000  # Of the first episode; the next ones have the next seeds.

    def filled_in(self, trained_for: str) -> Self:
        """With the maps and the task that are driven: where none is asked for, the policy's own."""
        from sim_pybullet.tasks.spec import find_task
        from trainer.division import maps_named

        task = self.task or trained_for
        return replace(self, task=task, map=maps_named(self.map) or (find_task(task).map,))

    def plain(self) -> dict[str, Any]:
        """``inputs`` of ``--json``; files from before there was sight read the same."""
        found = to_plain(self)
        found["maps"] = found.pop("map")
        usual = {"overhead": "always", "sight": None}
        return {k: v for k, v in found.items() if k not in usual or v != usual[k]}

    def check(self) -> None:
        """DuckpilotError unless these ask for something."""
        from robot.inference.policy import read_contract
        from sim_pybullet.randomise import load_look_sampler
        from sim_pybullet.sensing.guidance_feed import OVERHEAD
        from sim_pybullet.tasks.spec import find_task
        from trainer.config import LARGEST_SEED, expect_one_of
        from trainer.division import maps_named

        if not self.model:
            raise ConfigError("model: expected a policy, .onnx, got none")
        expect_between("episodes", self.episodes, 1, MOST_EPISODES)
        expect_between("seed", self.seed, 0, LARGEST_SEED - MOST_EPISODES)
        if self.zero is not None:
            expect_one_of("zero", self.zero, ZEROS)
        expect_one_of("overhead", self.overhead, OVERHEAD)
        load_look_sampler(self.look, self.pose_error, self.without)
        if not (self.task or Path(self.model).exists()):
            return  # yet
        spec = find_task(self.task or read_contract(self.model).task)
        if self.lane is not None and spec.lanes:
            expect_one_of("lane", self.lane, spec.lanes)
        for name in maps_named(self.map):
            spec.load(name)


@dataclass(frozen=True)
class WorkerOptions:
    """Who does many jobs."""

    workers: int | None = None  # Processes of a training, or jobs at once; else one for each core.
    ray: str | None = None  # On a Ray cluster: its address, or auto. Its nodes share this folder.
    gpus: float = 0.0  # Of the cluster's, for each process; less than 1: several share one.


@dataclass(frozen=True)
class SweepOptions(WorkerOptions):
    """Several runs in the place of one."""

    seeds: int | None = None  # So many, with those from --seed on; what is finished is skipped.
    matrix: Path | None = None  # YAML of options, each with a list of values: all combinations.

    @property
    def wanted(self) -> bool:
        """Whether any were asked for."""
        return self.seeds is not None or self.matrix is not None
