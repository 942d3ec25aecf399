"""From a configuration to a robot that can drive: opens what it names, and closes it again."""

import time
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Callable, ContextManager, Iterator, List, Optional, Tuple

from robot.camera.source import CAPTURE_PX, Camera, NewestFrame, open_stream
from robot.computer.clock import MonotonicClock
from robot.computer.health import Health
from robot.config import RobotConfig
from robot.contract import PolicyContract
from robot.errors import ConfigError
from robot.hat.thread import MotorThread, motors_on, own_bus
from robot.inference.policy import open_policy
from robot.lens import CameraRig
from robot.link import sockets
from robot.link.command_server import CommandServer
from robot.link.messages import FrameMessage, PosesMessage, Reading, Telemetry
from robot.link.sockets import Link
from robot.link.wire import tidy_text
from robot.navigation.lane_view import LaneView
from robot.navigation.navigator import MissionNavigator
from robot.navigation.neighbours import Company, Neighbours, Reports
from robot.navigation.road_map import load_map
from robot.navigation.road_paint import road_paint
from robot.navigation.road_watch import LaneWatch, RoadWatch, WaySeen
from robot.parts import Motors, Operator, Subscriber, Tick
from robot.recording.drive_file import Heard, describe
from robot.recording.recorder import Recorder
from robot.runtime.loop import Runtime
from robot.runtime.remote import RemoteOperator
from robot.runtime.reports import Reporter
from robot.runtime.timing import Watchdog
from robot.safety.governors import Rules
from robot.safety.state_machine import Safety, State
from robot.vision.plausibility import PictureDoubts
from robot.vision.road_fit import RoadFit
from robot.vision.sight import Glimpse, OnnxSight


@contextmanager
def open_robot(
    config: RobotConfig,
    operators: Tuple[Operator, ...] = (),
    subscribers: Tuple[Subscriber, ...] = (),
    camera: Optional[ContextManager[Camera]] = None,
    motors: Optional[ContextManager[Motors]] = None,
) -> Iterator[Runtime]:
    """Everything that ``config`` names, put together, with a watchdog; DISARMED.

    Operators come beside the one behind the link, subscribers beside the telemetry; camera and
    motors instead of the configured ones. DuckpilotError where model, map, configuration or keys
    are wrong, HardwareError where the HAT is not there, or another program drives it.
    """
    clock = MonotonicClock()
    watchdog = Watchdog(lambda: runtime.watch())
    policy = open_policy(config.model, config.translator)
    navigates, unproven = policy.contract.path_points > 0, policy.contract.unproven
    if navigates and not config.map:
        raise ConfigError(f"map: expected the map to navigate on, as {config.model} does, got none")
    if config.rules.stop_lines and not navigates:
        raise ConfigError(f"rules: expected headway at most, {config.model} knows no stop lines")
    with ExitStack() as stack:
        if motors is None:  # before anything that a robot which drives already would mind
            motors = motors_on(stack.enter_context(own_bus(config.hat)), config.hat)
        link = stack.enter_context(config.link.open()) if config.link else None
        seen = camera or NewestFrame(lambda: open_stream(config.camera, CAPTURE_PX), clock.now)
        eye = stack.enter_context(seen)
        wheels = stack.enter_context(motors)
        navigator: Optional[MissionNavigator] = None
        watch = None if navigates else open_watch(config, wheels, eye)
        everybody: List[Operator] = list(operators)
        audience: List[Subscriber] = [watchdog, *subscribers]
        if isinstance(wheels, MotorThread):
            audience.insert(1, wheels)
        if link is not None:
            if navigates:
                poses = sockets.Subscriber(link, PosesMessage).receive
                reports = {
                    each.name: sockets.Subscriber(link.to(each), Telemetry).receive
                    for each in link.config.robots
                }
                navigator = open_navigator(config, poses, wheels, eye, reports)
                audience.append(navigator)
            everybody.append(RemoteOperator(CommandServer(link), navigator))
        audience += open_reports(config, policy.contract, link, navigator, wheels, stack)
        rig = CameraRig(config.camera.lens, config.camera.mount)
        paint = road_paint(load_map(config.map)) if config.map else None
        never = unproven and f"the policy is {unproven}"
        runtime = Runtime(
            *(eye, policy, wheels, Safety(clock.now, config.safety, never), clock),
            *(audience, everybody, navigator or watch, PictureDoubts(RoadFit(rig, paint))),
            config.rules.chain(),
        )
        stack.enter_context(watchdog)
        yield runtime


def open_navigator(
    config: RobotConfig,
    receive: Callable[[], Optional[PosesMessage]],
    motors: Motors,
    camera: Camera,
    reports: Reports,
) -> MissionNavigator:
    """Plans on the map, from overhead poses, steps and sight; DuckpilotError: one is wrong."""
    glimpse = Glimpse(OnnxSight(config.sight), camera.read) if config.sight else None
    road_map = load_map(config.map)
    view = LaneView(road_map)
    others = Neighbours(view, config.name) if config.rules.headway else None
    others = Company(view, config.name, reports) if reports else others
    way = WaySeen() if others and glimpse else None
    watch = None if config.rules == Rules() else RoadWatch(view, others, way)
    return MissionNavigator(road_map, receive, lambda: motors.pose, config.name, glimpse, watch)


def open_watch(config: RobotConfig, motors: Motors, camera: Camera) -> Optional[LaneWatch]:
    """Sees what is in a lane keeper's way, for a headway; DuckpilotError: no sight, or wrong."""
    if not config.rules.headway:
        return None
    if not config.sight:
        raise ConfigError("rules.headway: expected sight as well: nothing else tells a lane keeper")
    return LaneWatch(Glimpse(OnnxSight(config.sight), camera.read), lambda: motors.pose)


def open_reports(
    config: RobotConfig,
    contract: PolicyContract,
    link: Optional[Link],
    navigator: Optional[MissionNavigator],
    motors: Motors,
    stack: ExitStack,
) -> List[Subscriber]:
    """What tells of each turn: reports and pictures for the monitor, and the recording."""
    others: List[Callable[[], Reading]] = []
    recorders: List[Subscriber] = []
    if config.recording is not None:

        def hear(tick: Tick) -> Heard:
            overhead = navigator.overhead if navigator is not None else None
            return Heard(tick, motors.pose, reporter.newest, overhead)

        recorder = stack.enter_context(Recorder(config.recording, describe(config, hear)))
        recorders.append(recorder)
        others.append(recorder.reading)
    about = Telemetry(
        config.name,
        State.DISARMED.value,
        model=tidy_text(Path(config.model).stem, 64),
        map=tidy_text(config.map, 64),
        actions=contract.actions,
    )
    publish, show = None, None
    if link is not None:
        others.append(link.allow_list.reading)
        publish = sockets.Publisher(link, Telemetry).send
        show = sockets.Publisher(link, FrameMessage).send
    health = Health(time.monotonic, others).readings
    reporter = Reporter(publish, show, about, config.safety, navigator, health)
    return [reporter, *recorders]
