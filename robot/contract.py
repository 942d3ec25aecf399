"""What simulator, trainer and robot must agree on: actions, pictures, policy metadata.

One place, so that a policy that drives in simulation meets the same numbers on the robot.
"""

import json
import math
from dataclasses import dataclass, field
from enum import IntEnum
from typing import ClassVar, NamedTuple, Optional, Tuple, Type, TypeVar

from robot.errors import ConfigError, ContractError
from robot.geometry import DifferentialDrive, Twist, WheelSpeeds
from robot.typed_config import from_plain, to_plain

SCHEMA_VERSION = 1

CONTROL_DT_S = 0.1  # one decision of the policy
FRAME_WIDTH_PX = 160  # camera frames are (FRAME_HEIGHT_PX, FRAME_WIDTH_PX, 3) uint8 RGB
FRAME_HEIGHT_PX = 120
PATH_POINTS = 10  # angles in path_input (paper A, section 3.3)
PATH_ANGLE_LIMIT_RAD = math.pi / 4
COMMANDS = 5  # that are told: what is longer ago shows in the picture, late as that may be
LEAST_PROVEN, LEAST_FORETOLD = 0.8, 0.75  # of a taught policy, else the robot does not arm
LEAST_STEERED = 40  # moments that it is asked about, where there was no twin to drive in
T = TypeVar("T", bound="InFile")


class Action(IntEnum):
    """The five choices of paper A, Figure 5, with its numbers."""

    LEFT = 0
    SLIGHT_LEFT = 1
    STRAIGHT = 2
    SLIGHT_RIGHT = 3
    RIGHT = 4


DRIVE = DifferentialDrive()

# A hard turn has a radius of 7.5 cm, so that it takes the tightest lane of any shipped map (13 cm)
# with room to correct; a slight turn one of 33 cm.
ACTION_TWISTS: Tuple[Twist, ...] = (
    Twist(0.18, 2.4),
    Twist(0.30, 0.9),
    Twist(0.30, 0.0),
    Twist(0.30, -0.9),
    Twist(0.18, -2.4),
)
ACTION_WHEELS: Tuple[WheelSpeeds, ...] = tuple(DRIVE.wheels(twist) for twist in ACTION_TWISTS)
MAX_WHEEL_MPS = max(max(wheels) for wheels in ACTION_WHEELS)
ActionTable = Tuple[Tuple[float, float], ...]
FIVE_ACTIONS: ActionTable = tuple((wheels[0], wheels[1]) for wheels in ACTION_WHEELS)
MOST_ACTIONS = 16  # that a policy may choose among
_FULL = Twist(ACTION_TWISTS[Action.STRAIGHT].forward_mps, ACTION_TWISTS[Action.LEFT].turn_radps)


class Stick(NamedTuple):
    """How a person drives: 1 steers as hard to the left as a hard turn, -1 to the right; speed 1 is
    that of straight on, -1 as fast backwards.
    """

    steer: float
    speed: float

    @property
    def wheels(self) -> WheelSpeeds:
        """What the wheels should do; more than they can where both are great."""
        return DRIVE.wheels(Twist(self.speed * _FULL.forward_mps, self.steer * _FULL.turn_radps))

    @classmethod
    def of(cls, wheels: WheelSpeeds) -> "Stick":
        """The stick that asks for these wheels."""
        twist = DRIVE.twist(wheels)
        return cls(twist.turn_radps / _FULL.turn_radps, twist.forward_mps / _FULL.forward_mps)


def shares(wheels: Tuple[float, float]) -> Tuple[float, ...]:
    """Rim speeds, left and right, as shares of the greatest of our actions, -1 to 1."""
    return tuple(min(max(each / MAX_WHEEL_MPS, -1.0), 1.0) for each in wheels)


def action_name(wheels: Tuple[float, float]) -> str:
    """What a person calls an action: STOP, one of the five, or else its rim speeds [m/s]."""
    left_mps, right_mps = wheels
    if left_mps == right_mps == 0.0:
        return "STOP"
    if (left_mps, right_mps) in FIVE_ACTIONS:
        return Action(FIVE_ACTIONS.index((left_mps, right_mps))).name
    return f"{left_mps:+.2f}|{right_mps:+.2f}"


@dataclass(frozen=True)
class ImageSpec:
    """The picture a policy sees: the frame resized to width x height, less its top rows."""

    width_px: int = FRAME_WIDTH_PX
    height_px: int = FRAME_HEIGHT_PX  # before the crop
    crop_top_px: int = 0  # rows above the horizon hold no road

    def __post_init__(self) -> None:
        if not (self.width_px > 0 and 0 <= self.crop_top_px < self.height_px):
            raise ConfigError(f"ImageSpec: expected 0 <= crop_top_px < height_px, got {self}")

    @property
    def shape(self) -> Tuple[int, int, int]:
        """(H, W, 3) of the picture after the crop."""
        return (self.height_px - self.crop_top_px, self.width_px, 3)


class InFile:
    """A frozen dataclass that travels inside an ONNX file, as JSON under its ``METADATA_KEY``."""

    METADATA_KEY: ClassVar[str]

    def to_json(self) -> str:
        """One line of JSON."""
        return json.dumps(to_plain(self), sort_keys=True)

    @classmethod
    def from_json(cls: Type[T], text: str) -> T:
        """Read what ``to_json`` wrote; ContractError for other JSON, or another version's."""
        what = f"metadata {cls.METADATA_KEY}"
        try:
            plain = json.loads(text)
        except (ValueError, RecursionError) as error:  # ValueError: numbers of 5000 digits, too
            raise ContractError(f"{what}: expected JSON, got: {error}") from error
        schema = plain.get("schema") if isinstance(plain, dict) else None
        if schema != SCHEMA_VERSION:
            told = f"expected schema {SCHEMA_VERSION}, got {schema!r}; export it again"
            raise ContractError(f"{what}: {told} with this version")
        return from_plain(cls, plain, where=what)


@dataclass(frozen=True)
class Proof:
    """How a taught policy drove before it came to a robot."""

    drives: int  # in the twin of the robot and floor that it was taught on; 0: without a map
    succeeded: int
    low: float  # 95 % sure: the share that succeeds is between these
    high: float
    steered: int  # clearly, moments of held-out recordings that the policy was asked about
    foretold: int  # of these it would have steered to the same side
    sentence: str
    fails: str = ""  # where on the map, and in which looks, most drives failed

    @property
    def problem(self) -> str:
        """Why this is not enough, or ""."""
        if self.drives and not self.low >= LEAST_PROVEN:
            return f"proven to {self.low:.0%} of drives, expected {LEAST_PROVEN:.0%}"
        if not self.drives and not self.steered >= LEAST_STEERED:
            return f"asked about {self.steered} moments of steering, expected {LEAST_STEERED}"
        if self.steered and not self.foretold >= LEAST_FORETOLD * self.steered:
            share = self.foretold / self.steered
            return f"foretells {share:.0%} of a person's steering, expected {LEAST_FORETOLD:.0%}"
        driven = not self.drives or 0 <= self.low * self.drives <= self.succeeded <= self.drives
        fits = driven and 0 <= self.foretold <= self.steered
        return "" if fits else "proven by figures that contradict each other"


@dataclass(frozen=True)
class PolicyContract(InFile):
    """Of every policy.

    ONNX inputs: ``image`` uint8 (N, H, W, 3 frames) RGB and, when ``told`` > 0, ``path`` float32
    (N, told) in [-1, 1]: the path ahead, then the last commands. Output: ``values`` float32 (N,
    actions); greedy is its argmax.
    """

    task: str  # lane, navigation, or another vehicle's
    algorithm: str
    image: ImageSpec = ImageSpec()
    path_points: int = 0
    commands: int = 0  # of the last decisions, the oldest first, each as `shares`
    actions: ActionTable = FIVE_ACTIONS  # each the left and right rim speed [m/s]
    control_dt_s: float = CONTROL_DT_S
    frames: int = 1  # pictures behind each other along the colour axis, the newest last
    run: str = ""  # name of the training run
    trained_steps: int = 0
    score: Optional[float] = None  # success rate of the training run's last evaluation
    schema: int = SCHEMA_VERSION
    notes: Tuple[str, ...] = field(default=())
    taught_from: str = ""  # the policy that was taught on a floor of one's own; "": this was not
    proof: Optional[Proof] = None  # of a taught policy

    METADATA_KEY = "duckpilot"

    @property
    def unproven(self) -> str:
        """Why a robot must not arm with this policy, or ""; only taught ones need a proof."""
        if not self.taught_from:
            return ""
        problem = "no proof" if self.proof is None else self.proof.problem
        return problem and f"taught from {self.taught_from}, {problem}; teach it again"

    def wheels(self, action: int) -> WheelSpeeds:
        """What the wheels do under an action."""
        return WheelSpeeds(*self.actions[action])

    @property
    def told(self) -> int:
        """How many numbers the network gets beside the picture."""
        return self.path_points + 2 * self.commands

    @property
    def picture_shape(self) -> Tuple[int, int, int]:
        """(H, W, 3 frames) of what the network sees."""
        height, width, channels = self.image.shape
        return (height, width, channels * self.frames)
