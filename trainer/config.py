"""What a run is: frozen dataclasses. `trainer.presets` fills them in."""

from dataclasses import dataclass

from robot.contract import COMMANDS, ImageSpec
from robot.errors import ConfigError, expect_between, expect_one_of
from sim_pybullet.tasks.spec import find_task
from trainer.algorithms import LearnConfig, find_algorithm

LARGEST_SEED = 2**31 - 1
WHOLE_FRAME = ImageSpec()


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
    backbone: str = ""  # an ONNX sight that sees for the policy, frozen, in place of convolutions


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
    learn: LearnConfig  # that of the algorithm
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
    lane: str = "outer"  # of a ring of road: driven the one way, the other, or both
    style: str = "race"  # of driving on tracks, see `sim_pybullet.tasks.track_racing.STYLES`
    commands: int = 0  # so many of its last ones each robot is told
    start_spread: float = 1.0  # in training, see `sim_pybullet.tasks.navigation`, `track_racing`
    relit: bool = False  # whether episodes are seen under lights of their own in training
    true_path: float = 0.0  # weight of the auxiliary task, see `trainer.learners.world`
    rate_left: float = 1.0  # of the learning rate at the last step; it falls on a straight line
    entropy_left: float = 1.0  # of the weight of the actor's entropy, after 60 % of the steps
    device: str = "cpu"  # of pictures and network: cpu, cuda, or auto: cuda if there is one
    workers: int = 1  # processes that learn together, see `trainer.training.crew`
    threads: int = 1  # of torch: a second process gains more than a second thread

    def __post_init__(self) -> None:
        task = find_task(self.task, to_learn=True)
        shares = find_algorithm(self.algorithm).shares
        alone = self.workers == 1
        if not (shares.fits(self.learn, self.workers) if shares and self.workers > 1 else alone):
            names = shares.divided if shares else ()
            what = ", ".join(f"{name} {getattr(self.learn, name)}" for name in names) or "1"
            raise ConfigError(f"workers: expected a number that divides {what}, got {self.workers}")
        expect_one_of("device", self.device, ("cpu", "cuda", "auto"))
        expect_one_of("style", self.style, task.styles or ("race",))
        expect_one_of("lane", self.lane, task.lanes or ("outer",))
        if self.commands not in (0, COMMANDS):
            raise ConfigError(f"commands: expected 0 or {COMMANDS}, got {self.commands}")
        if not (self.seconds is None or self.seconds > 0):
            raise ConfigError(f"run: expected seconds above 0, got {self.seconds}")
        if self.true_path and getattr(self.learn, "entropy", 1.0) <= 0.0:
            raise ConfigError(
                "true_path: expected learn.entropy above 0, whose weight in the loss it shares, "
                f"got {getattr(self.learn, 'entropy', None)}; or set true_path to 0"
            )
        limits = {
            "seed": (0, LARGEST_SEED),
            "steps": (1, 10**12),
            "start_spread": (1.0, 4.0),
            "true_path": (0.0, 100.0),
            "rate_left": (0.0, 1.0),
            "entropy_left": (0.0, 1.0),
        }
        for name, (least, most) in limits.items():
            expect_between(name, getattr(self, name), least, most)
