"""Who drives by hand at the monitor's page: an expert, and a person who watches the policy."""

import math
from typing import NamedTuple

import numpy as np

from robot.contract import Stick
from robot.geometry import Pose
from robot.navigation.planner import plan_path
from tools.loop.missions import ANSWER_S, DAWDLE_MPS, Driver, Line, MissionRecord, distance_m

AHEAD_M = 0.2  # what a hand steers for
HARD_PER_M = 8.0  # curvature of a hard turn at full speed: 2.4 rad/s at 0.3 m/s
WANDER_M, WAVE_M = 0.03, 1.3  # an expert shows how to come back, too
STRAYED_M, BACK_M = 0.045, 0.02  # from its path: a person takes over, and hands over again
NOTICES_S = 0.3
LONGEST_S = 8.0  # of one help
THERE_M = 0.03  # before the end of a way


class Aim(NamedTuple):
    """What a hand does now, and how far it is to the end of the way [m]."""

    stick: Stick
    left_m: float


def aim(line_m: Line, pose: Pose, aside_m: float = 0.0) -> Aim:
    """Steer for a point of a line through (M, 2) [m], ``aside_m`` to the left of it.

    Pure pursuit (Coulter 1992), slower in bends.
    """
    line = np.asarray(line_m, dtype=float)
    arc_m = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))))
    every_m = np.arange(0.0, arc_m[-1] + AHEAD_M, 0.01)
    points = np.stack([np.interp(every_m, arc_m, column) for column in line.T], axis=1)
    at = int(np.hypot(*(points - pose[:2]).T).argmin())
    i = min(at + round(AHEAD_M / 0.01), len(points) - 1)
    along = points[i] - points[max(i - 5, 0)]
    left = np.array([-along[1], along[0]]) / max(float(np.hypot(*along)), 1e-6)
    x_m, y_m = pose.to_robot(points[i] + aside_m * left)
    bend = 2.0 * y_m / max(x_m * x_m + y_m * y_m, 1e-6) / HARD_PER_M
    speed = 1.0 / (1.0 + abs(bend))
    stick = Stick(float(np.clip(bend * speed, -1.0, 1.0)), speed)
    return Aim(stick, float(arc_m[-1] - every_m[at]))


class Expert(Driver):
    """Drives the whole way by hand, knowing where the robot truly is."""

    def drive(self, destination: tuple[float, float] | None = None) -> MissionRecord:
        """See `Driver`."""
        record = self._draw(destination)
        operator, bench = self.bench.operator, self.bench
        way = plan_path(self._graph, bench.town.pose, record.destination).points_m
        self.rest()
        accepted, record.reason = operator.ask("arm")
        began_s, left_m = bench.now_s, record.length_m
        late_s = began_s + record.length_m / DAWDLE_MPS
        while accepted and left_m > THERE_M and bench.now_s < late_s:
            wave = math.sin(2.0 * math.pi * left_m / WAVE_M)
            stick, left_m = aim(way, bench.town.pose, WANDER_M * wave)
            operator.steer(stick)
            self._look()
            record.offsets_m.append(distance_m(way, bench.town.pose))
            if operator.state in ("HOLD", "FAULT"):
                record.reason, record.stop = operator.reason, self._standing()
                break
        record.phase = "arrived" if accepted and left_m <= THERE_M else "failed"
        operator.ask("disarm")
        record.seconds = bench.now_s - began_s
        record.missed_m = math.dist(bench.town.pose[:2], record.destination)
        return record


class Person(Driver):
    """Sends the policy, watches, takes over where it strays, and sends it again."""

    strayed_s = 0.0  # for how long by now
    helped = 0

    def _look(self) -> str:
        phase, began_s = super()._look(), self.bench.now_s
        path = self.bench.operator.robot.get("path") or ()
        off_m = distance_m(path, self.bench.town.pose) if len(path) > 1 else 0.0
        if phase != "driving" or off_m < STRAYED_M:
            self.strayed_s = began_s
        if began_s - self.strayed_s < NOTICES_S:
            return phase
        self.helped += 1
        goal = tuple(self.bench.operator.mission["destination"])
        while off_m > BACK_M and self.bench.now_s < began_s + LONGEST_S:
            self.bench.operator.steer(aim(path, self.bench.town.pose).stick)
            super()._look()
            off_m = distance_m(path, self.bench.town.pose)
        self.bench.operator.ask("mission", goal)
        self.strayed_s = self.bench.now_s
        while super()._look() != "driving" and self.bench.now_s < self.strayed_s + ANSWER_S:
            pass
        return str(self.bench.operator.mission.get("phase", ""))


DRIVERS = {"policy": Driver, "expert": Expert, "person": Person}
