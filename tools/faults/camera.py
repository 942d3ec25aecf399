"""The robot's camera: silent, frozen, slow, of the wrong size, garbage."""

from __future__ import annotations

import resource

from tools.faults.case import Act, Case
from tools.faults.stage import Stage
from tools.loop.town import CAMERA_FPS

FRAME_AGE_S = 0.2
# Five frames more with the same bytes, at the rate of decisions.
FROZEN_S = 0.6
SLOW_HZ = 3.0


def _broken(fault: str) -> Act:
    def inject(stage: Stage) -> None:
        stage.bench.town.camera.fault = fault

    return inject


def _one(fault: str) -> Act:
    def inject(stage: Stage) -> None:
        _broken(fault)(stage)
        stage.bench.town.camera.fault_ends = True

    return inject


def _no_descriptors(stage: Stage) -> None:
    """The robot may open nothing more, and its camera's device goes away."""
    robot = stage.bench.processes["robot"].child.pid
    _, most = resource.prlimit(robot, resource.RLIMIT_NOFILE)
    resource.prlimit(robot, resource.RLIMIT_NOFILE, (3, most))
    stage.bench.town.camera.hang_up()


def _descriptors_again(stage: Stage) -> None:
    robot = stage.bench.processes["robot"]
    if robot.alive:
        _, most = resource.prlimit(robot.child.pid, resource.RLIMIT_NOFILE)
        resource.prlimit(robot.child.pid, resource.RLIMIT_NOFILE, (most, most))


def _slow(stage: Stage) -> None:
    stage.bench.town.camera_event.period_s = 1.0 / SLOW_HZ


def _heal(stage: Stage) -> None:
    stage.bench.town.camera.fault = ""
    stage.bench.town.camera_event.period_s = 1.0 / CAMERA_FPS


CASES = (
    Case("stops", "no picture any more", _broken("stop"), FRAME_AGE_S, says="frame", heal=_heal),
    Case(
        *("freezes", "new pictures, each with the bytes of the last", _broken("freeze")),
        threshold_s=FROZEN_S,
        says="same picture",
        heal=_heal,
    ),
    Case("slows", f"{SLOW_HZ:g} pictures a second", _slow, FRAME_AGE_S, says="frame", heal=_heal),
    Case("wrong size", "80 x 60 px", _broken("size"), FRAME_AGE_S, says="frame", heal=_heal),
    Case(
        "garbage", "bytes that are none", _broken("garbage"), FRAME_AGE_S, says="frame", heal=_heal
    ),
    Case("one odd picture", "80 x 60 px, once", _one("size"), states=()),
    Case(
        *("no descriptors", "and the camera must be opened anew", _no_descriptors),
        threshold_s=FRAME_AGE_S,
        says="frame|Too many open files",
        heal=_descriptors_again,
        drives_again=True,
    ),
)
