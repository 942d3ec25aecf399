"""Where nobody can drive, and a robot that is not where it should be."""

from __future__ import annotations

from robot.geometry import Pose
from tools.faults.case import Case
from tools.faults.stage import Stage


def _ask_for(place: tuple[float, float], says: str) -> Case:
    name = "off the map" if says == "map" else "unreachable"

    def inject(stage: Stage) -> None:
        operator = stage.bench.operator
        operator.ask("arm")
        accepted, stage.note = operator.ask("mission", place)
        if accepted:
            stage.note = "accepted"

    def check(stage: Stage) -> str:
        stage.bench.operator.ask("disarm")
        return "" if stage.note != "accepted" else "the mission was accepted"

    return Case(name, f"a mission to {place}", inject, states=("READY",), moving=False, check=check)


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
    _ask_for((0.66, 2.0), "road"),
    _ask_for((9.0, 9.0), "map"),
    _carry(0.66, 2.0),
    Case("turned round", "somebody turns it", _turned, 1.0, ("FAULT", "HOLD")),
)
