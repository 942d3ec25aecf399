"""From a configuration to a robot that can drive: opens what it names, and closes it again."""

from __future__ import annotations

from contextlib import ExitStack, contextmanager, nullcontext
from pathlib import Path
from typing import ContextManager, Iterator, List, Optional, Protocol, Tuple

from robot.camera.gstreamer import GstStream, csi_command
from robot.camera.newest import NewestFrame, Stream
from robot.camera.replay import ReplayCamera
from robot.camera.source import Camera
from robot.camera.v4l2 import V4l2Stream
from robot.config import CameraConfig, RobotConfig
from robot.errors import ConfigError
from robot.geometry import Pose
from robot.hat.clock import Clock, MonotonicClock
from robot.hat.thread import real_motors
from robot.link.config import LinkConfig
from robot.link.messages import FrameMessage, PoseMessage
from robot.link.sockets import Link
from robot.link.telemetry import Telemetry
from robot.navigator import MissionNavigator
from robot.parts import Ask, Motors, Operator, Policy, Subscriber
from robot.policy import OnnxPolicy
from robot.remote import RemoteOperator
from robot.road_map import load_map
from robot.runtime import Runtime
from robot.safety import Safety, State
from robot.telemetry_feed import TelemetryFeed
from robot.translator import TranslatingPolicy, open_translator
from robot.watchdog import Watchdog

CAPTURE_PX = (320, 240)  # twice a frame: the last halving is by area, on the processor


class DrivenMotors(Motors, Protocol):
    """Motors that count their steps."""

    @property
    def pose(self) -> Pose:
        """Step odometry."""


@contextmanager
def open_robot(
    config: RobotConfig,
    operators: Tuple[Operator, ...] = (),
    subscribers: Tuple[Subscriber, ...] = (),
    camera: Optional[ContextManager[Camera]] = None,
    motors: Optional[ContextManager[DrivenMotors]] = None,
) -> Iterator[Runtime]:
    """Everything that ``config`` names, put together, with a watchdog; DISARMED.

    Args:
        config: of the robot.
        operators: beside the one behind the link.
        subscribers: beside the telemetry.
        camera: instead of the configured one.
        motors: instead of the HAT.

    Raises:
        DuckpilotError: model, map, configuration or keys are wrong.
        HardwareError: the HAT is not there.
    """
    clock = MonotonicClock()
    policy = open_policy(config)
    navigates = policy.contract.path_points > 0
    if navigates and not config.map:
        raise ConfigError(
            f"map: expected the map to navigate on, got none; {config.model} is a navigation policy"
        )
    with ExitStack() as stack:
        link = stack.enter_context(config.link.open()) if config.link else None
        eye = stack.enter_context(camera or open_camera(config.camera, clock))
        wheels = stack.enter_context(motors or real_motors(config.hat))
        navigator: Optional[MissionNavigator] = None
        everybody: List[Operator] = list(operators)
        audience: List[Subscriber] = list(subscribers)
        if link is not None and config.link is not None:
            if navigates:
                navigator = open_navigator(config, config.link, link, wheels)
                audience.append(navigator)
            everybody.append(RemoteOperator(config.link.command_server(link), navigator))
            audience.append(open_feed(config, config.link, link, navigator))
        runtime = Runtime(
            eye,
            policy,
            wheels,
            Safety(clock.now, config.safety),
            clock,
            audience,
            Operators(tuple(everybody)),
            navigator,
        )
        stack.enter_context(Watchdog(runtime.watch))
        yield runtime


def open_policy(config: RobotConfig) -> Policy:
    """The configured policy, behind the configured translator if there is one.

    Raises:
        ContractError: a file that cannot be used, or a translator of other pictures.
    """
    policy = OnnxPolicy(config.model)
    if not config.translator:
        return policy
    translator = open_translator(config.translator, policy.contract.image, "real-to-sim")
    return TranslatingPolicy(policy, translator)


def open_camera(config: CameraConfig, clock: Clock) -> ContextManager[Camera]:
    """The configured camera, running inside its ``with`` block.

    Raises:
        ConfigError: a replay of something that cannot be played.
    """
    if config.kind == "replay":
        return nullcontext(ReplayCamera(config.path, config.fps, clock.now))
    return NewestFrame(lambda: open_stream(config, CAPTURE_PX), clock.now)


def open_stream(config: CameraConfig, size_px: Tuple[int, int]) -> Stream:
    """The configured camera's pictures, one after the other; not of a replay.

    Raises:
        HardwareError: the device does not open.
    """
    if config.kind == "v4l2":
        return V4l2Stream(config.number, size_px, config.fps)
    return GstStream(csi_command(config.number, config.flip, config.fps, size_px), size_px)


def open_navigator(
    config: RobotConfig, streams: LinkConfig, link: Link, motors: DrivenMotors
) -> MissionNavigator:
    """Plans on the configured map, from the localizer's poses and the motors' steps."""
    poses = streams.subscriber(link, PoseMessage)
    road_map = load_map(config.map)
    return MissionNavigator(road_map, poses.receive, lambda: motors.pose, config.name)


def open_feed(
    config: RobotConfig, streams: LinkConfig, link: Link, navigator: Optional[MissionNavigator]
) -> TelemetryFeed:
    """Publishes reports and pictures."""
    about = Telemetry(
        config.name, State.DISARMED.value, model=Path(config.model).stem, map=config.map
    )
    reports, frames = streams.publisher(link, Telemetry), streams.publisher(link, FrameMessage)
    return TelemetryFeed(reports.send, frames.send, about, config.safety, navigator)


class Operators:
    """Several people at once; what any of them asks for counts."""

    def __init__(self, operators: Tuple[Operator, ...]) -> None:
        self._operators = operators

    def serve(self, ask: Ask) -> None:
        """Let each of them ask."""
        for operator in self._operators:
            operator.serve(ask)

    def age_s(self) -> Optional[float]:
        """The longest silence among those who must be heard [s]."""
        ages = [age_s for age_s in (each.age_s() for each in self._operators) if age_s is not None]
        return max(ages, default=None)
