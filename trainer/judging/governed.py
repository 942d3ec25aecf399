"""A policy under the rules of the road, which know what overhead poses of everybody tell."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from robot.contract import CONTROL_DT_S, MAX_WHEEL_MPS
from robot.geometry import Pose, WheelSpeeds
from robot.navigation.lane_view import LaneView
from robot.navigation.others import (
    AHEAD_M,
    HALF_DUCK_M,
    HALF_ROBOT_M,
    Crossings,
    Other,
    Traveller,
    free_way,
    turn_ahead,
)
from robot.navigation.road_map import RoadMap
from robot.safety.governors import NOSE_M, Lights, Road, Rule, StopLines, govern
from robot.safety.headway import KeepApart
from robot.safety.right_of_way import RightOfWay
from robot.safety.road_ahead import Light, RoadAhead
from robot.safety.wheel_limits import STILL, Drive
from sim_pybullet.batch import BatchWorld, Observation
from sim_pybullet.tasks.traffic import Traffic
from sim_pybullet.traffic.crowd import Bodies, Body
from trainer.judging.drivers import Pilot
from trainer.judging.evaluate import DrivingPolicy

_HALF_M = {Body.DUCK: HALF_DUCK_M, Body.ROBOT: HALF_ROBOT_M, Body.THING: HALF_DUCK_M}


@dataclass
class _Robot:
    """One robot's memory in an episode."""

    number: int
    pose: Pose  # a decision ago
    rules: tuple[Rule, ...]
    told: WheelSpeeds = STILL
    driven_m: float = 0.0
    velocity_mps: tuple[float, float] = (0.0, 0.0)

    def see(self, pose: Pose) -> None:
        """Where it is now."""
        moved = pose.x_m - self.pose.x_m, pose.y_m - self.pose.y_m
        self.driven_m += math.hypot(*moved)
        self.velocity_mps = moved[0] / CONTROL_DT_S, moved[1] / CONTROL_DT_S
        self.pose = pose

    def slow(self, wanted: np.ndarray, now_s: float, ahead: RoadAhead) -> WheelSpeeds:
        """What of the wheel speeds wanted (2,) [m/s] the rules allow."""
        road = Road(now_s, self.driven_m, max(map(abs, self.told)), ahead)
        self.rules, cap = govern(self.rules, road)
        drive = Drive(WheelSpeeds(*wanted.tolist()), self.told, CONTROL_DT_S, cap)
        self.told = drive.limited(MAX_WHEEL_MPS)
        return self.told

    @property
    def claims(self) -> bool:
        """Whether it claims the junction before it."""
        return any(rule.claims for rule in self.rules if isinstance(rule, RightOfWay))


class Governed(Pilot):
    """As `Pilot`, slowed by headway, stop lines, lights and right of way.

    Poses are true ones, of everybody and of now; robots tell each other their names, which way they
    take at the next junction, and that they claim it.
    """

    def __init__(self, policy: DrivingPolicy) -> None:
        super().__init__(policy)
        self._robots: dict[int, _Robot] = {}
        self._crossings: dict[int, Crossings] = {}
        self._views: dict[str, LaneView] = {}
        self._turns = 0

    def choose(self, world: BatchWorld, seen: Observation) -> np.ndarray:
        """See `trainer.judging.drivers.Driver`."""
        task = world.task
        assert isinstance(task, Traffic)
        shares = super().choose(world, seen)
        self._turns += 1
        self._see(world, task)
        lanes_m = task.paths.points_at(task.course.arc_m[:, None] + AHEAD_M)
        velocities = np.array([self._robots[i].velocity_mps for i in range(world.n_robots)])
        grouped = [
            each.reshape(-1, task.group, each.shape[-1]) for each in (world.poses, velocities)
        ]
        bodies = task.crowd.bodies(*grouped)
        red = task.crowd.look(grouped[0], task.paths, task.course.arc_m, grouped[1]).red
        for group in range(len(red)):
            ours = range(group * task.group, (group + 1) * task.group)
            road_map = task.road_maps[world.maps[ours[0]]]
            travellers = {f"{i:03}": self._traveller(i, road_map, lanes_m[i]) for i in ours}
            at = self._crossings[group].update(self._turns * CONTROL_DT_S, travellers)
            for place, i in enumerate(ours):
                if not world.active[i]:
                    continue
                robot, told = self._robots[i], travellers[f"{i:03}"]
                others = _others(bodies, group, place)
                way = free_way(lanes_m[i], robot.pose, told.speed_mps, others)
                light = Light.RED if red[group, place] else Light.NONE
                junction = at.get(f"{i:03}")
                ahead = RoadAhead(way.free_m, 0.0, way.closing_mps, told.line_m, light, junction)
                wanted = MAX_WHEEL_MPS * shares[i]
                slowed = robot.slow(wanted, self._turns * CONTROL_DT_S, ahead)
                shares[i] = np.array(slowed) / MAX_WHEEL_MPS
        return shares

    def _see(self, world: BatchWorld, task: Traffic) -> None:
        """Where robots are now; who begins an episode remembers nothing."""
        poses = [Pose(*pose) for pose in world.poses.tolist()]
        for i, (number, pose) in enumerate(zip(world.numbers.tolist(), poses, strict=True)):
            known = self._robots.get(i)
            if known is None or (number >= 0 and number != known.number):
                rng = np.random.default_rng((number, i % task.group))
                rules = (KeepApart(), StopLines(), Lights(), RightOfWay(rng))
                self._robots[i] = _Robot(number, pose, rules)
                if i % task.group == 0:
                    road_map = task.road_maps[world.maps[i]]
                    self._crossings[i // task.group] = Crossings(road_map)
            self._robots[i].see(pose)

    def _traveller(self, i: int, road_map: RoadMap, lane_m: np.ndarray) -> Traveller:
        robot = self._robots[i]
        if road_map.name not in self._views:
            self._views[road_map.name] = LaneView(road_map)
        line_m = self._views[road_map.name].line_ahead_m(robot.pose) - NOSE_M
        speed_mps = math.hypot(*robot.velocity_mps)
        if line_m > AHEAD_M[-1]:
            return Traveller(robot.pose, speed_mps)
        turn = turn_ahead(road_map, robot.pose, lane_m)
        return Traveller(robot.pose, speed_mps, line_m, turn, robot.claims)


def _others(bodies: Bodies, group: int, place: int) -> list[Other]:
    rows = zip(bodies.xy_m[group], bodies.velocities_mps[group], bodies.kinds, strict=True)
    return [
        Other(xy[0], xy[1], v[0], v[1], _HALF_M[Body(kind)], kind == Body.DUCK)
        for k, (xy, v, kind) in enumerate(rows)
        if k != place and np.isfinite(xy[0])
    ]
