"""What a run is: frozen dataclasses, and the presets ``paper``, ``fast`` and ``debug``.

``paper`` is the network and picture of the Duckiebot paper (Figures 7 and 15), ``fast`` the same
shape made small enough for two CPU cores, ``debug`` takes seconds and learns nothing.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TypeVar

from robot.contract import ACTION_WHEELS, PATH_POINTS, ActionTable, ImageSpec
from robot.errors import ConfigError, nearest
from sim_pybullet.racing.racing_cars import FRAMES, RACING_ACTIONS
from sim_pybullet.randomise import is_reality
from sim_pybullet.tasks.track_racing import STYLES

T = TypeVar("T")

_WHOLE_FRAME = ImageSpec()
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
    """Imitation of the expert on the learner's own states (Ross et al. 2011)."""

    robots: int = 16
    learning_rate: float = 5e-4
    batch: int = 128
    dagger_every: int = 4  # steps of all robots between updates
    gradient_steps: int = 2
    buffer: int = 40_000
    warm_up: int = 500
    expert_steps: int = 2_000  # over which the expert's share of the driving falls from 1 to 0
    random_share: float = 0.08  # of the actions, so that recoveries are seen
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
    image: ImageSpec = _WHOLE_FRAME
    net: NetConfig = NetConfig()
    evaluation: EvaluationConfig = EvaluationConfig()
    look: str = "nominal"  # a file, or the name of a shipped look or distribution of looks
    without: tuple[str, ...] = ()  # groups and fields of the look that stay nominal
    pose_error: str | None = None  # none or arena, in place of the look's own
    translate: str | None = None  # an ONNX translator that every picture passes through
    style: str = "race"  # of driving on tracks, see `sim_pybullet.tasks.track_racing.STYLES`
    start_spread: float = 1.0  # of navigation in training, see `sim_pybullet.tasks.navigation`
    true_path: float = 0.0  # weight of the auxiliary task, see `trainer.learners.true_path`
    rate_left: float = 1.0  # of the learning rate at the last step; it falls on a straight line
    entropy_left: float = 1.0  # of the weight of the actor's entropy, after 60 % of the steps
    device: str = "cpu"  # of the network: cpu, cuda or auto
    threads: int = 1  # of torch: with a second one small networks are slower, not faster

    def __post_init__(self) -> None:
        choose("task", self.task, TASKS)
        choose("algorithm", self.algorithm, ALGORITHMS)
        choose("style", self.style, STYLES)
        if is_reality(self.look):
            raise ConfigError(
                f"look: expected one to train in, got {self.look!r}: those in reality/ are kept "
                "for judging policies; evaluate in it, or train in randomised"
            )
        if self.steps < 1 or not (self.seconds is None or self.seconds > 0):
            got = f"steps {self.steps}, seconds {self.seconds}"
            raise ConfigError(f"run: expected steps >= 1 and seconds > 0, got {got}")
        if self.true_path and getattr(self.learn, "entropy", 1.0) <= 0.0:
            raise ConfigError(
                "true_path: expected learn.entropy above 0, whose weight in the loss it shares, "
                f"got {getattr(self.learn, 'entropy', None)}; or set true_path to 0"
            )
        for name in ("rate_left", "entropy_left"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise ConfigError(
                    f"{name}: expected a share from 0 to 1, got {getattr(self, name)}"
                )


def cruising(config: RunConfig) -> RunConfig:
    """The run in the style "cruise": what a turn is worth shows at once, and choices stay open.

    With a farther view or less entropy a driver weaves, for which it hardly pays: learned from the
    true road ahead, it held the wheels straight 16 % of the time instead of 50 %.

    Raises:
        ConfigError: the run is not one on tracks.
    """
    if config.task != "track":
        raise ConfigError(f"style: expected race for the task {config.task!r}, got 'cruise'")
    learn = config.learn
    if isinstance(learn, (PpoConfig, A2cConfig, A3cConfig)):
        learn = replace(learn, gamma=0.9, entropy=0.02)
    return replace(config, learn=learn, style="cruise")


def judged(config: RunConfig) -> RunConfig:
    """The run in whose world the greedy driving between updates takes place."""
    elsewhere = config.evaluation
    config = replace(config, start_spread=1.0, maps=elsewhere.maps or config.maps)
    if not elsewhere.look:
        return config
    return replace(config, look=elsewhere.look, translate=None, without=())


_PAPER_NET = NetConfig((32, 64, 64), image_fc=512, path_fc=(64, 128), head_fc=256)
_FAST_IMAGE = ImageSpec(80, 60, crop_top_px=20)
_TRACK_IMAGE = ImageSpec(48, 36, crop_top_px=4)
_DEBUG_NET = NetConfig((4, 4, 4), image_fc=16, path_fc=(8, 8), head_fc=16)


def preset(task: str, algorithm: str, name: str) -> RunConfig:
    """The named starting point of a run.

    Raises:
        ConfigError: an unknown name, with the nearest known one.
    """
    learn = choose("algorithm", algorithm, ALGORITHMS)
    maps = (choose("task", task, TASKS),)
    run = RunConfig(task, algorithm, name, learn, maps, image=_FAST_IMAGE)
    if task == "navigation":
        run = _navigation(run)
    elif task == "track":
        run = _track(run)
    makers = {"paper": _paper, "fast": lambda config: config, "debug": _debug}
    return choose("preset", name, makers)(run)


def choose(what: str, name: str, valid: Mapping[str, T]) -> T:
    """``valid[name]``, or a ConfigError that names the nearest choice."""
    if name not in valid:
        raise ConfigError(f"{what}: unknown {name!r}; {nearest(name, valid)}")
    return valid[name]


def _navigation(run: RunConfig) -> RunConfig:
    """A run uses all its steps, the last ones to settle: few failures are left to learn from."""
    learn = run.learn
    if isinstance(learn, QConfig):
        learn = replace(learn, gamma=0.9, action_gap=0.8, epsilon_steps=10_000)
    steps = 60_000 if isinstance(learn, (PpoConfig, A2cConfig, A3cConfig)) else 24_000
    evaluation = EvaluationConfig(
        episodes=60, rounds=3, every_steps=8_000, every_share=0.25, stop_after_perfect=0
    )
    told = isinstance(learn, (QConfig, PpoConfig, A2cConfig))
    return replace(
        run,
        learn=learn,
        steps=steps,
        evaluation=evaluation,
        start_spread=4.0,
        true_path=1.0 if told else 0.0,
        rate_left=0.03,
    )


def _track(run: RunConfig) -> RunConfig:
    """Pictures reach up to the horizon, where a fast car looks; a reward is worth what it is."""
    # Who begins at rest finds brakes bad. With a small bonus for entropy they are given up before
    # there is speed to need them for; so the bonus begins large, and falls to nothing.
    learn = run.learn
    if isinstance(learn, PpoConfig):
        learn = replace(learn, rollout=32, epochs=4, learning_rate=2e-3)
        learn = replace(learn, gae_lambda=0.95, entropy=0.2)
    if isinstance(learn, A3cConfig):
        learn = replace(learn, robots=8, learning_rate=3e-4, warm_up=30_000)
        learn = replace(learn, entropy=0.2, normalised=True)
    if isinstance(learn, A2cConfig):
        learn = replace(learn, entropy=0.02)  # of rewards of some 0.1 a decision
    if isinstance(learn, (QConfig, DaggerConfig)):
        learn = replace(learn, buffer=20_000)  # 18 kB a stack of pictures, kept twice: 0.7 GB
    if not isinstance(learn, DaggerConfig):
        learn = replace(learn, gamma=0.98)
    return replace(
        run,
        learn=learn,
        image=_TRACK_IMAGE,
        net=NetConfig((16, 32)),
        reward_scale=1.0,
        steps=400_000 if isinstance(learn, PpoConfig) else 800_000,
        evaluation=EvaluationConfig(episodes=8, every_steps=10_000),
        rate_left=0.1,
        entropy_left=0.0,
    )


def _paper(run: RunConfig) -> RunConfig:
    net = _PAPER_NET if run.task == "lane" else replace(_PAPER_NET, image_fc=256)
    learn = run.learn
    if run.task == "track":
        net = replace(net, channels=(32, 64, 64, 64))
    if isinstance(learn, A3cConfig):  # paper B, section 3.1
        learn = replace(learn, robots=1, learning_rate=0.01, rms_decay=0.9, rms_epsilon=0.1)
        learn = replace(learn, entropy=0.02, normalised=False, warm_up=0)
    if isinstance(learn, (QConfig, DaggerConfig)):
        learn = replace(learn, buffer=20_000 // SHAPES[run.task].frames)  # 58 kB each, kept twice
    return replace(run, image=_WHOLE_FRAME, net=net, learn=learn, steps=2_000_000, device="auto")


def _debug(run: RunConfig) -> RunConfig:
    small = {"robots": 4}
    if isinstance(run.learn, (QConfig, DaggerConfig)):
        small.update(buffer=1_000, warm_up=64, batch=16)
    elif isinstance(run.learn, A3cConfig):
        small.update(robots=1, workers=2)
    elif isinstance(run.learn, PpoConfig):
        small.update(rollout=16, minibatch=32)
    learn = replace(run.learn, **small)  # type: ignore[arg-type]
    evaluation = EvaluationConfig(episodes=2, every_steps=256)
    net = replace(_DEBUG_NET, channels=_DEBUG_NET.channels[: len(run.net.channels)])
    return replace(run, net=net, learn=learn, evaluation=evaluation, steps=512)
