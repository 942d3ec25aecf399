"""Random missions, one after the other, driven as a person at the monitor's page would."""

import math
from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from robot.errors import PlanError
from robot.geometry import Pose, wrap_angle
from robot.navigation.planner import LaneGraph, plan_path
from tools.loop.bench import Bench
from tools.loop.timekeeper import BenchError

SHORTEST_M = 1.0  # a mission is at least so long
DAWDLE_MPS = 0.1  # a mission slower than this on average is given up
SETTLE_S = 3.0  # until a robot that was carried is found again
ANSWER_S = 10.0
FIND_S = 90.0  # for a robot without localizer to be sure of its place,
TOLD_M, TOLD_RAD = 0.1, math.radians(20.0)  # of which a person knows so much
STILL_S = 0.5  # without a step: the robot stands
PAUSE_S = 1.0  # a person looks before they arm again
RECORDED_S = 4.5  # at rest: the robot has completed its recording


@dataclass(frozen=True)
class Stop:
    """The robot gave up a mission."""

    fault: str  # the reason that the page shows
    latency_s: float  # from the report of it to the last step of a motor
    state: str


@dataclass
class MissionRecord:
    """What became of one mission."""

    start: Pose
    destination: tuple[float, float]
    length_m: float  # as planned from the true pose
    phase: str = "refused"
    reason: str = ""
    seconds: float = 0.0
    missed_m: float = math.nan  # true distance to the destination at the end
    offsets_m: list[float] = field(default_factory=list)  # true distance from the robot's path
    errors: list[tuple[float, float]] = field(default_factory=list)  # of the robot's pose: m, rad
    stop: Stop | None = None

    @property
    def arrived(self) -> bool:
        """Whether the robot says so, and it is true."""
        return self.phase == "arrived" and self.missed_m < 0.15


class Driver:
    """Sends the robot of a bench on missions."""

    def __init__(self, bench: Bench, rng: np.random.Generator) -> None:
        self.bench, self._rng = bench, rng
        self._graph = LaneGraph(bench.road_map)
        self._truth: list[tuple[float, Pose]] = []  # when [s], and where it was
        self._judged = -1

    def anywhere(self) -> Pose:
        """A place in the middle of some lane."""
        lanes = self.bench.road_map.lanes
        lane = lanes[int(self._rng.integers(len(lanes)))]
        return lane.pose_at(float(self._rng.uniform(0.1, 0.9)))

    def on_lane(self, x_m: float, y_m: float) -> Pose:
        """On the lane nearest to a place, along it. PlanError: the place is not on the road."""
        road_map = self.bench.road_map
        near = road_map.lane_index.near(x_m, y_m)
        i = int(near.distance_m.argmin())
        at = road_map.lanes[i].pose_at(float(near.t[i]))
        plan_path(self._graph, at._replace(x_m=x_m, y_m=y_m), (at.x_m, at.y_m))
        return at

    def carry(self) -> None:
        """Put the robot down somewhere, and wait until it knows where it is."""
        pose = self.anywhere()
        self.bench.revive()
        self.bench.town.world.place(pose)
        if self.bench.options.localizer:
            self.bench.until(self._found, ANSWER_S + SETTLE_S, "the robot to find itself")

    def find(self) -> None:
        """A person tells roughly where the robot stands, and lets it drive on until it is sure."""
        operator = self.bench.operator
        self.rest()
        away_m, aside_rad = self._rng.uniform(0.0, TOLD_M), self._rng.uniform(-math.pi, math.pi)
        told = self.bench.town.pose.moved(0.0, aside_rad).moved(away_m, 0.0).moved(0.0, -aside_rad)
        told = told.moved(0.0, self._rng.uniform(-TOLD_RAD, TOLD_RAD))
        operator.ask("place", told.moved(1.0, 0.0)[:2], start=told[:2])
        for kind in ("arm", "auto"):
            operator.ask(kind)
        self.rest()
        stands = lambda: self._look() is not None and operator.state != "AUTO"  # noqa: E731
        self.bench.until(stands, FIND_S, "the robot to know its place")

    def drive(self, destination: tuple[float, float] | None = None) -> MissionRecord:
        """One mission from where the robot is; to a random place unless told."""
        record = self._draw(destination)
        operator = self.bench.operator
        self.rest()
        for kind, place in (("arm", None), ("mission", record.destination)):
            accepted, record.reason = operator.ask(kind, place)
            if not accepted:
                operator.ask("disarm")
                return record
        began_s = self.bench.now_s
        self.bench.until(lambda: self._look() == "driving", ANSWER_S, "the mission to begin")
        late_s = began_s + record.length_m / DAWDLE_MPS
        while self._look() == "driving" and self.bench.now_s < late_s:
            record.offsets_m.append(distance_m(operator.robot["path"], self.bench.town.pose))
            self._judge(record)
        record.phase = operator.mission.get("phase", "lost")
        record.reason = "" if record.phase == "arrived" else operator.reason
        record.seconds = self.bench.now_s - began_s
        record.missed_m = math.dist(self.bench.town.pose[:2], record.destination)
        if record.phase != "arrived" and operator.state in ("HOLD", "FAULT"):
            record.stop = self._standing()
        if record.phase != "arrived":
            operator.ask("stop")
            operator.ask("clear" if operator.state == "FAULT" else "disarm")
        return record

    def rest(self) -> None:
        """A person looks before they arm; a recording is over by then."""
        until_s = self.bench.now_s + (RECORDED_S if self.bench.options.record else PAUSE_S)
        while self.bench.now_s < until_s:
            self._look()

    def _standing(self) -> Stop:
        """How the robot stopped that reports HOLD or FAULT, once it stands."""
        operator, town = self.bench.operator, self.bench.town
        fault, state, told_s = operator.reason, operator.state, operator.robot["t_sent_s"]
        while self.bench.now_s < max(told_s, town.moved_s) + STILL_S:
            self._look()
        return Stop(fault, max(town.moved_s - told_s, 0.0), state)

    def _draw(self, destination: tuple[float, float] | None) -> MissionRecord:
        start = self.bench.town.pose
        if destination is not None:
            length_m = plan_path(self._graph, start, destination).length_m
            return MissionRecord(start, destination, length_m)
        for _ in range(1000):
            goal = self.anywhere()
            place = (goal.x_m, goal.y_m)
            try:
                path = plan_path(self._graph, start, place)
            except PlanError:
                continue
            if path.length_m >= SHORTEST_M:
                return MissionRecord(start, place, path.length_m)
        raise BenchError(f"expected a mission to be possible from {start}, found none")

    def _look(self) -> str:
        """A turn of the page; the phase of the mission."""
        self._truth.append((self.bench.now_s, self.bench.town.pose))
        self.bench.operator.turn()
        return str(self.bench.operator.mission.get("phase", ""))

    def _found(self) -> bool:
        self._look()
        believed = self.bench.operator.robot.get("pose")
        return believed is not None and math.dist(believed[:2], self.bench.town.pose[:2]) < 0.08

    def _judge(self, record: MissionRecord) -> None:
        """Compare a new report's pose with where the robot was when it was sent."""
        report = self.bench.operator.robot
        pose, sent_s = report.get("pose"), report.get("t_sent_s", 0.0)
        index = bisect_left(self._truth, (sent_s,))
        if pose is None or report["sequence"] == self._judged or index == len(self._truth):
            return
        self._judged = report["sequence"]
        (before_s, before), (after_s, after) = self._truth[max(index - 1, 0)], self._truth[index]
        share = (sent_s - before_s) / max(after_s - before_s, 1e-9)
        way = np.subtract(after, before)
        x_m, y_m, heading_rad = before + share * np.array([*way[:2], wrap_angle(way[2])])
        error_rad = float(wrap_angle(pose[2] - heading_rad))
        record.errors.append((math.dist((x_m, y_m), pose[:2]), error_rad))


def distance_m(line_m: Sequence[tuple[float, float]] | np.ndarray, pose: Pose) -> float:
    """From the robot to a line through points x, y [m]."""
    points = np.asarray(line_m, dtype=float)
    place, ways = np.array(pose[:2]), np.diff(points, axis=0)
    squares = np.maximum((ways**2).sum(axis=1), 1e-12)
    shares = np.clip(((place - points[:-1]) * ways).sum(axis=1) / squares, 0.0, 1.0)
    return float(np.hypot(*(points[:-1] + shares[:, None] * ways - place).T).min())
