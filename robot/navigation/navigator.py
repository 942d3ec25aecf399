"""``MissionNavigator``: from a destination to the path input of each moment.

Overhead poses, late and noisy, are fused with the wheels' steps; A* plans from where the robot
believes to be; then it follows that path until it arrives or has left it. A robot that missed a
turn, but drives in another lane, is led on from there.
"""

import math
from dataclasses import replace
from typing import Callable, Optional, Tuple

import numpy as np

from robot.errors import PlanError
from robot.geometry import Pose, wrap_angle
from robot.link.freshness import PoseGate
from robot.link.messages import (
    FAR_M,
    TEXT_BYTES,
    XY,
    Belief,
    MissionStatus,
    PoseMessage,
    PosesMessage,
    thin_path,
)
from robot.link.wire import tidy_text
from robot.navigation.finding import STRANGE, Finding
from robot.navigation.fusion import FusionConfig, PoseFusion
from robot.navigation.lane_view import LaneView
from robot.navigation.neighbours import AHEAD_M
from robot.navigation.path import Path, PathPosition, path_input
from robot.navigation.planner import LaneGraph, plan_path
from robot.navigation.road_map import RoadMap
from robot.navigation.road_watch import RoadWatch
from robot.navigation.sight_fix import SightFix
from robot.navigation.way_check import WayCheck
from robot.navigation.whereabouts import On
from robot.parts import Guidance, Tick
from robot.safety.road_ahead import RoadAhead
from robot.safety.state_machine import State
from robot.vision.sight import Glimpse

ARRIVAL_M = 0.05  # left to drive: a decision drives 3 cm
# The middle of the yellow line, seen from the middle of the lane: beyond it the robot is on the
# wrong side, whatever the pose's error.
OFF_PATH_TILES = 0.25
MAX_HEADING_ERROR_RAD = math.radians(100.0)
IN_LANE_TILES = 0.1  # from its middle, along it within
IN_LANE_RAD = math.radians(30.0)
DETOURS = 3  # in one mission; then something is wrong with the robot
MAP_MARGIN_M = 0.3  # a pose may lie so far outside before it is refused
USUAL_DELAY_S = 0.25  # of overhead poses, from the picture to the robot
WORD = (0.05, 0.05, math.radians(10.0))  # deviations of a pose that a person tells
HEARD_S = 1.0  # a source that said nothing for so long holds the belief no more
BOUND_S = 1.0  # with wheels that seem to be off by as much as wheels can be
JUMPS = 5  # unbelievable poses in a row: the robot was carried, or its map is another


class MissionNavigator:
    """Plans and follows missions on one map; a ``Navigator`` and a ``Subscriber`` of the runtime.

    ``receive`` gives the newest overhead poses since the last call, or None, and never blocks;
    ``robot`` is its name among them. ``odometry`` counts steps from anywhere. Without a ``glimpse``
    overhead poses alone tell the place, without a ``watch`` the road ahead is empty. MapError for a
    map without road.
    """

    def __init__(
        self,
        road_map: RoadMap,
        receive: Callable[[], Optional[PosesMessage]],
        odometry: Callable[[], Pose],
        robot: str,
        glimpse: Optional[Glimpse] = None,
        watch: Optional[RoadWatch] = None,
    ) -> None:
        east, north = road_map.width_m + MAP_MARGIN_M, road_map.height_m + MAP_MARGIN_M
        self.status: Optional[MissionStatus] = None
        self.path_points: Tuple[XY, ...] = ()  # of the mission, for the monitor
        self.overhead: Optional[PoseMessage] = None  # the newest that came, believed or not
        self._road_map = road_map
        self._beside_m = OFF_PATH_TILES * road_map.tile_size_m
        self._graph = LaneGraph(road_map)
        self._receive, self._odometry, self._robot = receive, odometry, robot
        self._gate = PoseGate(robot, (-MAP_MARGIN_M, -MAP_MARGIN_M, east, north))
        self._fusion = PoseFusion(config=FusionConfig(sight=glimpse is not None))
        self._way, self._glimpse = WayCheck(), glimpse
        views = [LaneView(road_map)] if glimpse is not None else []
        self._fix, self._watch = SightFix(self._fusion, views), watch
        self._finding = None if glimpse is None else Finding(self._graph, self._fix)
        self._within_s = math.inf  # when the wheels last seemed to be off by less than their bound
        self._odometer, self._driven_m = odometry(), 0.0
        self._jumps = 0
        self._arrived_s = -math.inf  # when the last pose came that the fusion took
        self._driving = self._on_mission = False
        self._path: Optional[Path] = None
        self._hint: Optional[int] = None
        self._detours = 0

    @property
    def pose(self) -> Optional[Pose]:
        """Where the robot believes to be; None until the first overhead pose."""
        x_m, y_m, heading_rad = (float(value) for value in self._fusion.poses[0])
        return Pose(x_m, y_m, heading_rad) if math.isfinite(x_m + y_m + heading_rad) else None

    def put(self, pose: Pose) -> None:
        """A person says where the robot stands, to 10 cm and 20 degrees; PlanError where not."""
        if self._finding is None:
            raise PlanError("expected a robot with sight; only a localizer tells where this is")
        if self._driving:
            raise PlanError("expected a robot that stands, it drives")
        if not self._road_map.on_road(pose.x_m, pose.y_m):
            raise PlanError("expected a place on the road, that is beside it")
        self._fusion.put(np.arange(1), np.array([pose]), WORD)
        self._finding.learned, self._finding.strange = False, 0.0
        self._way.reset()
        self._jumps = 0

    def belief(self, now_s: float) -> Optional[Belief]:
        """How surely the place is known, and by what; None without sight, or a pose."""
        if self._glimpse is None or self.pose is None:
            return None
        sources = {"overhead": self._arrived_s, "sight": float(self._fix.took_s[0])}
        heard = [name for name, at_s in sources.items() if now_s - at_s < HEARD_S]
        long_m, short_m, along_rad = np.minimum(self._fusion.ellipses[0], FAR_M).tolist()
        turned = self._fusion.certainty[0, 1]
        return Belief(long_m, short_m, along_rad, float(turned), (*heard, "wheels")[0])

    def begin(self, mission: str, destination_m: XY) -> None:
        """Plan from here to ``destination_m`` [m], not the mission under way; errors as ``plan``.

        How the robot drives is learned anew: what a fault of the last mission taught ends here.
        Only a robot with sight that arrived, or drove on until it was sure, keeps it: it knows the
        way along by its wheels.
        """
        path = self.plan(destination_m)
        self._take(path)
        arrived = self.status is not None and self.status.phase == "arrived"
        if self._finding is None or not (arrived or self._finding.learned):
            self._fusion.relearn(np.arange(1))
        self._way.reset()
        self._detours = 0
        self.status = MissionStatus(mission, destination_m, remaining_m=path.length_m)

    def plan(self, destination_m: XY) -> Path:
        """The way from here to ``destination_m`` [m]; changes nothing.

        PlanError where there is none, or the robot's place is unknown or too far from any way.
        """
        if self.pose is None:
            if self._finding is not None and self._finding.sentence:
                raise PlanError(self._finding.sentence)
            raise PlanError(
                "expected an overhead pose of this robot before a mission, got none yet; "
                "does the localizer see it, and does the link reach it?"
            )
        path = plan_path(self._graph, self.pose, destination_m)
        at = path.project(self.pose.x_m, self.pose.y_m, 0)
        if any(self._lost(at, self.pose)):
            turned_deg = math.degrees(float(wrap_angle(self.pose.heading_rad - at.heading_rad)))
            raise PlanError(
                f"expected the robot in a lane (within {100.0 * self._beside_m:.0f} cm of its "
                f"middle), it stands {100.0 * abs(at.offset_m):.0f} cm beside the nearest one, "
                f"turned by {turned_deg:.0f} degrees; put it into a lane, or drive it there by hand"
            )
        return path

    def end(self, phase: str, reason: str = "") -> None:
        """The mission is over: ``stopped`` or ``failed``, and why."""
        if self.status is not None and self.status.phase == "driving":
            self.status = replace(self.status, phase=phase, reason=tidy_text(reason, TEXT_BYTES))
        self._path, self.path_points = None, ()

    def on_tick(self, tick: Tick) -> None:
        """A mission ends when the policy no longer drives: nobody may resume it unawares."""
        state = tick.verdict.state
        if state is not State.AUTO and (self._driving or self._path is not None):
            if self._driving and self._finding is not None:
                self._finding.learned = not self._on_mission and self._finding.sure
            self.end("stopped", tick.verdict.sentence)
        self._driving = state is State.AUTO
        self._on_mission = self._driving and (self._on_mission or self._path is not None)

    def look(self, now_s: float) -> Guidance:
        """Take what poses and steps have come, and see where that is on the path."""
        self._move(now_s)
        self._measure(now_s)
        self._see()
        pose, doubt = self.pose, self._way.doubt
        if not self._fusion.at_bound[0]:
            self._within_s = now_s
        within: Optional[Tuple[float, float]] = None  # asked where not only overhead poses tell
        if self._glimpse is not None:
            place_m, turned_rad = self._fusion.certainty[0].tolist()
            within = (place_m, turned_rad) if pose is not None else (math.inf, math.inf)
        alone = now_s - self._arrived_s >= HEARD_S  # pictures alone tell the place
        strange = alone and self._finding is not None and self._finding.strange > STRANGE
        guidance = Guidance(
            pose=pose,
            # Time without a pose, and the delay of the last one beyond what is usual. Steps bridge
            # gaps, whatever the poses' steady delay: it is in the estimate already.
            pose_age_s=max(
                now_s - self._arrived_s, float(self._fusion.age_s(now_s)[0]) - USUAL_DELAY_S
            ),
            pose_within=within,
            driven_m=self._driven_m,
            off_map=pose is not None and self._road_map.tile_at(pose.x_m, pose.y_m) is None,
            pose_jump=self._jumps >= JUMPS or strange,
            pose_doubt=(doubt.doubtful and not doubt.stands) or now_s - self._within_s > BOUND_S,
            not_moving=doubt.doubtful and doubt.stands,
            duplicate_publisher=self._gate.stream.conflict(now_s),
        )
        if pose is not None and self._path is not None and self.status is not None:
            return self._follow(guidance, self._path, pose, self.status, now_s)
        on = self._finding.on(now_s, self._driving) if self.searches and self._finding else None
        return guidance if on is None else self._drive_on(guidance, on, now_s)

    @property
    def searches(self) -> bool:
        """Whether it may drive on without a destination, until it knows its place and wheels."""
        destined = self._on_mission or self._path is not None  # a mission's end is the drive's
        return not destined and self._finding is not None and not self._finding.sure

    def _drive_on(self, guidance: Guidance, on: On, now_s: float) -> Guidance:
        """Who looks for its place may drive on as a lane keeper does, while it sees a lane."""
        unseen = (math.inf, math.inf) if self._driving else guidance.pose_within  # for a mission
        return guidance._replace(
            path=path_input(on.path, on.pose, on.at.index),
            pose_within=(0.0, 0.0) if on.seen else unseen,
            off_path=any(self._lost(on.at, on.pose)),
            ahead=RoadAhead() if self._watch is None else self._watch.look(now_s, self._driven_m),
        )

    def _follow(
        self, guidance: Guidance, path: Path, pose: Pose, status: MissionStatus, now_s: float
    ) -> Guidance:
        at = path.project(pose.x_m, pose.y_m, self._hint)
        self._hint = at.index
        remaining_m = max(0.0, path.length_m - at.arc_m)
        arrived = remaining_m <= ARRIVAL_M
        self.status = replace(
            status,
            progress=min(1.0, at.arc_m / path.length_m),
            remaining_m=remaining_m,
            offset_m=at.offset_m,
            phase="arrived" if arrived else status.phase,
        )
        astray, turned = self._lost(at, pose)
        detour = self._detour(pose, status) if astray and not turned else None
        if detour is not None:
            told = f"missed a turn; detour {self._detours} of at most {DETOURS}"
            return self._follow(guidance, detour, pose, replace(status, reason=told), now_s)
        ahead = RoadAhead()
        if self._watch is not None:
            place = pose, float(self._fusion.certainty[0, 0])
            way_m = path.batch.points_at(at.arc_m + AHEAD_M[None])[0]
            ahead = self._watch.look(now_s, self._driven_m, place, way_m)
        return guidance._replace(
            path=path_input(path, pose, at.index),
            arrived=arrived,
            off_path=astray or turned,
            ahead=ahead,
        )

    def _lost(self, at: PathPosition, pose: Pose) -> Tuple[bool, bool]:
        """Whether the robot is too far beside its path, and too far turned from it."""
        turned_rad = abs(float(wrap_angle(pose.heading_rad - at.heading_rad)))
        return abs(at.offset_m) > self._beside_m, turned_rad > MAX_HEADING_ERROR_RAD

    def _detour(self, pose: Pose, status: MissionStatus) -> Optional[Path]:
        """Another way, for a robot that drives in another lane than planned; None in none."""
        near = self._road_map.lane_index.near(pose.x_m, pose.y_m)
        turned_rad = np.abs(np.asarray(wrap_angle(pose.heading_rad - near.heading_rad)))
        in_lane = near.distance_m <= IN_LANE_TILES * self._road_map.tile_size_m
        if self._detours == DETOURS or not (in_lane & (turned_rad <= IN_LANE_RAD)).any():
            return None
        try:
            path = plan_path(self._graph, pose, status.destination)
        except PlanError:
            return None
        self._detours += 1
        return self._take(path)

    def _take(self, path: Path) -> Path:
        self._path, self._hint = path, 0
        self.path_points = thin_path(path.points_m)
        return path

    def _move(self, now_s: float) -> None:
        last, self._odometer = self._odometer, self._odometry()
        arc_m, turn_rad = last.arc_to(self._odometer)
        self._fusion.move(np.array([arc_m]), np.array([turn_rad]), now_s)
        if self._finding is not None:
            self._finding.move(arc_m, turn_rad, now_s)
        self._driven_m += arc_m
        self._way.stepped(now_s, self._odometer)

    def _measure(self, now_s: float) -> None:
        poses = self._receive()
        if poses is not None and self._watch is not None and self._watch.others is not None:
            self._watch.others.hear(poses.every, now_s)
        message = None if poses is None else poses.of(self._robot)
        if message is None:
            return
        self.overhead = message
        refused, places = self._gate.stream.refused, ("jump", "off the map")
        before = sum(refused[why] for why in places)
        if not self._gate.take(message, now_s):
            self._jumps += sum(refused[why] for why in places) - before
            return
        age_s = float(self._fusion.age_s(now_s)[0])
        heading_rad = math.nan if message.heading_rad is None else message.heading_rad
        captured_s = now_s - self._gate.stream.age_s(now_s)
        measured = np.array([[message.x_m, message.y_m, heading_rad]])
        self._fusion.measure(measured, np.array([captured_s]))
        if math.isnan(heading_rad) and self.pose is not None:
            heading_rad = self.pose.heading_rad
        if not math.isnan(heading_rad):
            self._way.see(captured_s, Pose(message.x_m, message.y_m, heading_rad))
        self._jumps = int(self._fusion.rejected[0])
        if self._fusion.age_s(now_s)[0] < age_s:
            self._arrived_s = now_s

    def _see(self) -> None:
        glimpsed = None if self._glimpse is None else self._glimpse.look()
        if glimpsed is None:
            return
        seen, taken_s = glimpsed
        if self._finding is not None:
            self._finding.see(seen, taken_s)
        if self._watch is not None:
            self._watch.saw(seen, self._driven_m, taken_s)
