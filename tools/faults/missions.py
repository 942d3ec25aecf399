"""Where nobody can drive, and a robot that is not where it should be."""

from __future__ import annotations

import math
import re

from robot.geometry import Pose
from tools.faults.case import Case
from tools.faults.stage import Stage


def _ask_for(name: str, place: tuple[float, float]) -> Case:
    def inject(stage: Stage) -> None:
        accepted, stage.note = stage.bench.operator.ask("mission", place, arm=True)
        if accepted:
            stage.note = "accepted"

    def check(stage: Stage) -> str:
        return "" if "road" in stage.note else f"expected to hear of the road, got: {stage.note}"

    return Case(
        *(name, f"arm and drive to {place}", inject),
        states=("DISARMED",),
        says="started|disarm",
        moving=False,
        check=check,
    )


def _from_elsewhere(stage: Stage) -> None:
    stage.note = stage.bench.operator.ask("mission", stage.goal, arm=True, start=stage.goal)[1]


def _told_how_far(stage: Stage) -> str:
    away_m = math.dist(stage.goal, stage.bench.town.pose[:2])
    found = re.search(r"it is ([0-9.]+) m from there", stage.note)
    near = found is not None and abs(float(found[1]) - away_m) < 0.05
    return "" if near else f"expected to hear of {away_m:.2f} m, got: {stage.note}"


def _carry(x_m: float, y_m: float) -> Case:
    def inject(stage: Stage) -> None:
        stage.bench.town.world.place(Pose(x_m, y_m, 0.0))

    return Case(
        *("carried away", f"somebody puts it down at ({x_m}, {y_m})", inject),
        threshold_s=1.0,  # five unbelievable poses in a row, or no believable one for so long
        states=("FAULT", "HOLD"),
    )


def _turned(stage: Stage) -> None:
    pose = stage.bench.town.pose
    stage.bench.town.world.place(Pose(pose.x_m, pose.y_m, pose.heading_rad + 2.2))


CASES = (
    _ask_for("unreachable", (0.66, 2.0)),
    _ask_for("off the map", (9.0, 9.0)),
    Case(
        *("wrong start", "a mission from where the robot is not", _from_elsewhere),
        states=("DISARMED",),
        moving=False,
        check=_told_how_far,
    ),
    _carry(0.66, 2.0),
    Case("turned round", "somebody turns it", _turned, 1.0, ("FAULT", "HOLD")),
)
