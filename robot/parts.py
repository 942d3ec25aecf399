"""What the runtime is put together from, as protocols, and what it tells about each turn."""

from dataclasses import dataclass
from typing import Callable, NamedTuple, Optional, Protocol, Tuple

import numpy as np

from robot.camera.source import Frame
from robot.contract import PolicyContract
from robot.geometry import Pose, WheelSpeeds
from robot.safety.gates import Inputs
from robot.safety.road_ahead import RoadAhead
from robot.safety.state_machine import Answer, Command, Verdict
from robot.safety.wheel_limits import Drive

Ask = Callable[[Command, Optional[WheelSpeeds]], Answer]


class Motors(Protocol):
    """Both wheels; `robot.hat.thread.MotorThread` on the robot. HardwareError from every method."""

    @property
    def pose(self) -> Pose:
        """Step odometry, from anywhere."""

    def set_wheels(self, wheels: WheelSpeeds) -> object:
        """Aim for these rim speeds [m/s]; what it returns does not matter."""

    def stop(self) -> None:
        """No further step; the coils hold."""

    def release(self) -> None:
        """Stop, coils off."""

    def mend(self) -> None:
        """Take up work again after an error, coils off; nothing to do without one."""


class Policy(Protocol):
    """What decides; `robot.inference.policy.OnnxPolicy` on the robot."""

    contract: PolicyContract  # what it sees and does

    def values(self, images: np.ndarray, path: Optional[np.ndarray] = None) -> np.ndarray:
        """(N, actions) for images (N, H, W, 3) and what it is told beside them (N, told)."""


class Guidance(NamedTuple):
    """Where the robot is on its way. ``path`` (path_points,) is None without a mission."""

    path: Optional[np.ndarray] = None
    pose: Optional[Pose] = None
    pose_age_s: float = float("inf")  # of the newest overhead pose
    pose_within: Optional[Tuple[float, float]] = None  # see `robot.safety.gates.Inputs`
    ahead: RoadAhead = RoadAhead()
    driven_m: float = 0.0  # by the wheels' steps, since anywhere
    arrived: bool = False
    off_path: bool = False
    off_map: bool = False
    pose_jump: bool = False
    pose_doubt: bool = False  # see `robot.safety.gates.Inputs`
    not_moving: bool = False
    duplicate_publisher: bool = False


class Navigator(Protocol):
    """Follows the mission; without one the robot keeps its lane."""

    def look(self, now_s: float) -> Guidance:
        """The guidance of this moment."""


class Operator(Protocol):
    """The person's side: hands over what they ask for, and knows how long they were silent."""

    def serve(self, ask: Ask) -> None:
        """Give each new request to ``ask``, which answers at once; never wait for one."""

    def age_s(self) -> Optional[float]:
        """Time since the last sign of life [s]; None for somebody who stands beside the robot."""


@dataclass(frozen=True)
class Tick:
    """One turn of the loop, as the subscribers hear of it."""

    number: int
    time_s: float  # when it began
    frame: Optional[Frame]
    values: Optional[np.ndarray]  # (actions,) of the policy
    action: Optional[int]  # the policy's choice among its contract's, driven or not
    wheels: WheelSpeeds  # as sent to the motors [m/s]
    verdict: Verdict
    inputs: Inputs
    guidance: Optional[Guidance]
    duration_s: float  # from its beginning to the wheels
    lag_s: float  # how late it began
    drive: Optional[Drive] = None  # what the wheels were asked for; None at rest
    commands: Tuple[float, ...] = ()  # that the policy was told of, as `robot.contract.shares`


class Subscriber(Protocol):
    """Recording, telemetry, plots. What it raises stops the robot."""

    def on_tick(self, tick: Tick) -> None:
        """Called at the end of every turn; must return soon."""
