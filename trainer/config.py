"""What a run is: frozen dataclasses. `trainer.presets` fills them in."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TypeVar

from robot.contract import ACTION_WHEELS, PATH_POINTS, ActionTable, ImageSpec
from robot.errors import ConfigError, expect_between, nearest
from sim_pybullet.racing.racing_cars import FRAMES, RACING_ACTIONS
from sim_pybullet.randomise import is_reality
from sim_pybullet.tasks.lane_keeping import LANES
from sim_pybullet.tasks.track_racing import STYLES

T = TypeVar("T")

LARGEST_SEED = 2**31 - 1
MOST_STEPS = 10**12

WHOLE_FRAME = ImageSpec()
WHEELED: ActionTable = tuple((wheels[0], wheels[1]) for wheels in ACTION_WHEELS)

TASKS = {"lane": "loop", "navigation": "arena", "track": "forest"}  # and where it is learned
TESTS = {
    **TASKS,
    "four_laps": "loop",
    "manoeuvres": "arena",
}  # what can be evaluated, and where by default


@dataclass(frozen=True)
class TaskShape:
    """What a task's policy sees and may choose."""

    actions: ActionTable = WHEELED
    path_points: int = 0
    frames: int = 1  # stacked pictures


SHAPES: Mapping[str, TaskShape] = {
    "lane": TaskShape(),
    "navigation": TaskShape(path_points=PATH_POINTS),
    "track": TaskShape(RACING_ACTIONS, frames=FRAMES),
}


@dataclass(frozen=True)
class NetConfig:
    """Widths of the network; kernels and strides are in `trainer.learners.networks`."""

    channels: tuple[int, ...] = (16, 32, 32)  # of the three or four convolutions
    image_fc: int = 256  # first fully connected layer, shared by actor and critic
    path_fc: tuple[int, int] = (64, 128)  # the path branch, where there is one
    head_fc: int = 128  # second fully connected layer, one per head
    # Whether pixels become -1..1 instead of 0..1. Of four stacked pictures the brightness that all
    # share is else most of each gradient, and first convolutions die of it.
    centred: bool = False


@dataclass(frozen=True)
class QConfig:
    """Double DQN (van Hasselt et al. 2016), plain or dueling (Wang et al. 2016)."""

    robots: int = 16
    learning_rate: float = 5e-4
    gamma: float = 0.95
    n_step: int = 3
    batch: int = 128
    gradient_steps: int = 1  # per step of all robots
    buffer: int = 40_000  # transitions
    warm_up: int = 500  # random steps before the first update
    target_tau: float = 0.01  # the target network follows by this share each step of all robots
    epsilon_final: float = 0.02
    epsilon_steps: int = 4_000  # from 1 to final
    max_grad_norm: float = 10.0
    action_gap: float = 0.0  # advantage learning, see `trainer.learners.dqn`: 0 none, below 1


@dataclass(frozen=True)
class PpoConfig:
    """Proximal policy optimisation (Schulman et al. 2017)."""

    robots: int = 32
    learning_rate: float = 5e-4
    gamma: float = 0.95
    rollout: int = 64  # steps of each robot between updates
    minibatch: int = 256
    epochs: int = 3
    gae_lambda: float = 0.9
    clip: float = 0.2
    entropy: float = 0.01
    value: float = 0.5
    max_grad_norm: float = 0.5


@dataclass(frozen=True)
class A2cConfig:
    """Advantage actor-critic (Mnih et al. 2016, without the asynchrony)."""

    robots: int = 32
    learning_rate: float = 1e-3
    gamma: float = 0.95
    a2c_rollout: int = 8
    gae_lambda: float = 0.9
    entropy: float = 0.01
    value: float = 0.5
    max_grad_norm: float = 0.5


@dataclass(frozen=True)
class DaggerConfig:
    """Imitation of an expert on the learner's own states (Ross et al. 2011)."""

    robots: int = 16
    learning_rate: float = 5e-4
    batch: int = 128
    dagger_every: int = 4  # steps of all robots between updates
    gradient_steps: int = 2
    buffer: int = 40_000
    warm_up: int = 500
    expert_steps: int = 2_000  # over which the expert's share of the driving falls from 1 to 0
    random_share: float = 0.08  # of the actions, so that recoveries are seen
    coach_steps: int = 0  # by which the expert is learned, see `trainer.learners.coach`; 0: a rule
    max_grad_norm: float = 10.0


@dataclass(frozen=True)
class A3cConfig:
    """Asynchronous advantage actor-critic (Mnih et al. 2016)."""

    workers: int = 12
    robots: int = 1  # of each worker
    learning_rate: float = 7e-4
    gamma: float = 0.95
    a3c_rollout: int = 20
    rms_decay: float = 0.99
    rms_epsilon: float = 1e-8  # under the root; gradients' squares here are some 1e-7
    warm_up: int = 0  # decisions, of all, while the learning rate rises from nothing
    normalised: bool = False  # advantages to mean 0 and deviation 1 in each rollout, as in PPO
    entropy: float = 0.01
    value: float = 0.5
    max_grad_norm: float = 0.5


AlgorithmConfig = QConfig | PpoConfig | A2cConfig | DaggerConfig | A3cConfig

ALGORITHMS: Mapping[str, AlgorithmConfig] = {
    "ddqn": QConfig(),
    "dueling": QConfig(),
    "a2c": A2cConfig(),
    "a3c": A3cConfig(),
    "ppo": PpoConfig(),
    "dagger": DaggerConfig(),
    "coached": DaggerConfig(coach_steps=200_000),
}


@dataclass(frozen=True)
class EvaluationConfig:
    """Greedy driving between updates: decides which policy is kept, and when to stop."""

    episodes: int = 20
    rounds: int = 1  # episodes of each robot: with more, fewer wait for the longest to end
    every_steps: int = 2_000  # and after 8,000 steps a quarter of the steps so far
    every_share: float = 0.0  # of all steps of the run, where that is more
    stop_after_perfect: int = 2  # evaluations in a row without a failure; 0 never stops
    maps: tuple[str, ...] = ()  # where, if not where it is trained
    look: str = ""  # in which look, if not in that of the training; nothing is translated then


@dataclass(frozen=True)
class RunConfig:
    """Everything that makes a run what it is; ``config.yaml`` of its folder."""

    task: str
    algorithm: str
    preset: str
    learn: AlgorithmConfig
    maps: tuple[str, ...] = ("loop",)  # files, or names of shipped maps
    seed: int = 0
    steps: int = 200_000  # decisions of all robots together
    seconds: float | None = None  # wall clock, over all resumptions
    reward_scale: float = 0.05  # what a learner gets of the task's reward; the record has it whole
    image: ImageSpec = WHOLE_FRAME
    net: NetConfig = NetConfig()
    evaluation: EvaluationConfig = EvaluationConfig()
    look: str = "nominal"  # a file, or the name of a shipped look or distribution of looks
    without: tuple[str, ...] = ()  # groups and fields of the look that stay nominal
    pose_error: str | None = None  # none or arena, in place of the look's own
    translate: str | None = None  # an ONNX translator that every picture passes through
    lane: str = "outer"  # of a ring, in the task lane: driven the one way, the other, or both
    style: str = "race"  # of driving on tracks, see `sim_pybullet.tasks.track_racing.STYLES`
    start_spread: float = 1.0  # in training, see `sim_pybullet.tasks.navigation`, `track_racing`
    relit: bool = False  # whether episodes are seen under lights of their own in training
    true_path: float = 0.0  # weight of the auxiliary task, see `trainer.learners.true_path`
    rate_left: float = 1.0  # of the learning rate at the last step; it falls on a straight line
    entropy_left: float = 1.0  # of the weight of the actor's entropy, after 60 % of the steps
    device: str = "cpu"  # of the network: cpu, cuda or auto
    threads: int = 1  # of torch: with a second one small networks are slower, not faster

    def __post_init__(self) -> None:
        choose("task", self.task, TASKS)
        choose("algorithm", self.algorithm, ALGORITHMS)
        choose("style", self.style, STYLES)
        choose("lane", self.lane, dict.fromkeys(LANES))
        for use, look in (("train", self.look), ("choose", self.evaluation.look)):
            if is_reality(look):
                raise ConfigError(
                    f"look: expected one to {use} in, got {look!r}: those in reality/ are kept for "
                    "judging policies; evaluate in it when the policy is chosen, and train and "
                    "choose in randomised"
                )
        expect_between("seed", self.seed, 0, LARGEST_SEED)
        if self.steps < 1 or not (self.seconds is None or self.seconds > 0):
            got = f"steps {self.steps}, seconds {self.seconds}"
            raise ConfigError(f"run: expected steps >= 1 and seconds > 0, got {got}")
        expect_between("steps", self.steps, 1, MOST_STEPS)
        if self.true_path and getattr(self.learn, "entropy", 1.0) <= 0.0:
            raise ConfigError(
                "true_path: expected learn.entropy above 0, whose weight in the loss it shares, "
                f"got {getattr(self.learn, 'entropy', None)}; or set true_path to 0"
            )
        if not (1.0 <= self.start_spread <= 4.0 and 0.0 <= self.true_path <= 100.0):
            raise ConfigError(
                "run: expected a start_spread from 1 to 4 and a true_path from 0 to 100, got "
                f"{self.start_spread} and {self.true_path}"
            )
        for name in ("rate_left", "entropy_left"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise ConfigError(
                    f"{name}: expected a share from 0 to 1, got {getattr(self, name)}"
                )


def judged(config: RunConfig) -> RunConfig:
    """The run in whose world the greedy driving between updates takes place."""
    elsewhere = config.evaluation
    config = replace(config, start_spread=1.0, maps=elsewhere.maps or config.maps)
    if not elsewhere.look:
        return config
    return replace(config, look=elsewhere.look, translate=None, without=())


def choose(what: str, name: str, valid: Mapping[str, T]) -> T:
    """``valid[name]``, or a ConfigError that names the nearest choice."""
    if name not in valid:
        raise ConfigError(f"{what}: unknown {name!r}; {nearest(name, valid)}")
    return valid[name]
