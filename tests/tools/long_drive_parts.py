"""What the long drive makes up: pictures, wheels that roll as told, localizer and monitor."""

from __future__ import annotations

import math

import numpy as np

from robot.camera.source import Frame
from robot.contract import DRIVE
from robot.geometry import Pose, WheelSpeeds
from robot.inference.preprocess import FRAME_SHAPE
from robot.link.command_client import CommandClient
from robot.link.messages import FrameMessage, Mission, PosesMessage, Sighting, Telemetry
from robot.link.sockets import Clock, LinkConfig, Publisher, Subscriber
from robot.navigation.road_map import RoadMap, load_map
from robot.parts import Tick

STILL = WheelSpeeds(0.0, 0.0)
BLOCK_PX = 10  # as JPEG as large as pictures of roads are, which noise of every pixel is not
LOOK_S = 1.0  # a person looks before they arm again


def start_of(name: str) -> Pose:
    """The beginning of a lane of this map."""
    first = np.asarray(load_map(name).lanes[0].control_points_m)
    ahead = first[1] - first[0]
    return Pose(float(first[0][0]), float(first[0][1]), math.atan2(ahead[1], ahead[0]))


class MadeUpCamera:
    """A new picture at every read; no two in a row are the same."""

    def __init__(self, clock: Clock, count: int) -> None:
        rng = np.random.default_rng(0)
        height, width, _ = FRAME_SHAPE
        coarse = rng.integers(
            0, 256, (count, height // BLOCK_PX, width // BLOCK_PX, 3), dtype=np.uint8
        )
        self._pictures = coarse.repeat(BLOCK_PX, axis=1).repeat(BLOCK_PX, axis=2)
        self._clock, self._sequence = clock, 0

    def read(self) -> Frame:
        """The next one."""
        self._sequence += 1
        picture = self._pictures[self._sequence % len(self._pictures)]
        return Frame(picture, self._sequence, self._clock())


class MadeUpMotors:
    """Wheels that roll exactly as told."""

    def __init__(self, start: Pose, clock: Clock) -> None:
        self._pose, self._wheels, self._clock = start, STILL, clock
        self._rolled_s = clock()

    @property
    def pose(self) -> Pose:
        """Where they have rolled to."""
        now_s = self._clock()
        twist, dt_s = DRIVE.twist(self._wheels), now_s - self._rolled_s
        self._pose = self._pose.moved(twist.forward_mps * dt_s, twist.turn_radps * dt_s)
        self._rolled_s = now_s
        return self._pose

    def set_wheels(self, wheels: WheelSpeeds) -> None:
        """Roll at these speeds [m/s]."""
        self._pose = self.pose
        self._wheels = wheels

    def stop(self) -> None:
        """Stand."""
        self.set_wheels(STILL)

    def release(self) -> None:
        """Stand."""
        self.set_wheels(STILL)

    def mend(self) -> None:
        """They never fail."""

    def carry(self, pose: Pose) -> None:
        """Somebody puts the robot down there."""
        self._pose, self._rolled_s = pose, self._clock()


class Others:
    """Localizer and monitor, as a subscriber: true poses, beats, and the next mission.

    A robot that is refused its mission has strayed, and is put back into a lane.
    """

    def __init__(
        self, localizer: LinkConfig, monitor: LinkConfig, motors: MadeUpMotors, clock: Clock
    ) -> None:
        self.missions = self.stops = self.carried = 0
        self._configs = (localizer, monitor)
        self._motors, self._clock = motors, clock
        self._asked_s = clock()
        self._places = _places(load_map("arena"))
        self._state = self._mission = ""
        self._open()

    def on_tick(self, tick: Tick) -> None:
        """Look from above, listen, and ask for what is next."""
        x_m, y_m, heading_rad = self._motors.pose
        heading_rad = math.remainder(heading_rad, 2.0 * math.pi)
        self._poses.send(
            PosesMessage((Sighting("robot", x_m, y_m, heading_rad, 0.9),), tick.time_s)
        )
        for answer in self._client.poll():
            if answer.id == self._mission and "put it into a lane" in answer.reason:
                self.carried += 1
                self._motors.carry(start_of("arena"))
        self._frames.receive()
        report = self._reports.receive()
        if report is not None:
            self._ask(report)

    def reconnect(self) -> None:
        """Both programs are started again."""
        self.close()
        self._open()

    def close(self) -> None:
        """Hang up."""
        for link in self._links:
            link.close()

    def _open(self) -> None:
        localizer, monitor = self._configs
        self._links = [localizer.open(), monitor.open()]
        self._poses = Publisher(self._links[0], PosesMessage)
        self._reports = Subscriber(self._links[1], Telemetry)
        self._frames = Subscriber(self._links[1], FrameMessage)
        self._client = CommandClient(self._links[1])

    def _ask(self, report: Telemetry) -> None:
        arrived = report.mission is not None and report.mission.phase == "arrived"
        if report.state != self._state:
            self.stops += report.state in ("HOLD", "FAULT") and not arrived
            self._state = report.state
        if report.state == "AUTO" or self._clock() - self._asked_s < LOOK_S:
            return
        self._asked_s = self._clock()
        if report.state == "READY":
            self.missions += 1
            place = self._places[self.missions % len(self._places)]
            self._mission = self._client.send("mission", Mission(place))
        else:
            self._client.send("clear" if report.state == "FAULT" else "arm")


def _places(road_map: RoadMap) -> list[tuple]:
    middles = [np.asarray(lane.control_points_m).mean(axis=0) for lane in road_map.lanes]
    return [(float(x), float(y)) for x, y in middles[:: max(1, len(middles) // 9)]]
