"""The robot's camera: silent, frozen, slow, garbage."""

from __future__ import annotations

import resource

import numpy as np

from robot.camera.streams import MAGIC
from tools.faults.case import Act, Case, change, the_camera
from tools.faults.pictures import WELL, shortly, spoiled
from tools.faults.stage import Stage
from tools.loop.town import CAMERA_FPS

FRAME_AGE_S = 0.2
FROZEN_S = 0.6  # five frames more with the same bytes, at the rate of decisions
SLOW_HZ = 3.0


def _rate(hz: float) -> Act:
    return change(lambda stage: stage.bench.town.camera_event, period_s=1.0 / hz)


def _may_open(stage: Stage, most: int | None = None) -> None:
    """The robot may have so many files open, or as many as it can."""
    robot = stage.bench.processes["robot"]
    if robot.alive:
        _, limit = resource.prlimit(robot.child.pid, resource.RLIMIT_NOFILE)
        soft = limit if most is None else most
        resource.prlimit(robot.child.pid, resource.RLIMIT_NOFILE, (soft, limit))


def _no_descriptors(stage: Stage) -> None:
    _may_open(stage, 3)
    the_camera(stage).hang_up()


def halved(picture: np.ndarray) -> np.ndarray:
    """Every second row and column."""
    return picture[::2, ::2]


def _frozen(stage: Stage) -> None:
    frozen = stage.bench.town.world.see()
    the_camera(stage).spoil = lambda _: frozen


CAMERA = (
    Case(
        *("stops", "no picture any more", change(the_camera, silent=True), FRAME_AGE_S, "frame"),
        heal=change(the_camera, silent=False),
    ),
    Case(
        *("freezes", "new pictures, each with the bytes of the last", _frozen),
        *(FROZEN_S, "same picture"),
        heal=WELL,
    ),
    Case(
        *("slows", f"{SLOW_HZ:g} pictures a second", _rate(SLOW_HZ), FRAME_AGE_S, "frame"),
        heal=_rate(CAMERA_FPS),
    ),
    spoiled("wrong size", "80 x 60 px", halved, (FRAME_AGE_S, "frame", ("FAULT",))),
    Case(
        *("garbage", "bytes that are none", change(the_camera, magic=b"\x00\xff\x17\x80")),
        *(FRAME_AGE_S, "frame"),
        heal=change(the_camera, magic=MAGIC),
    ),
    shortly("one odd picture", "80 x 60 px, once", halved, 1),
    Case(
        *("no descriptors", "and the camera must be opened anew", _no_descriptors),
        *(FRAME_AGE_S, "frame|Too many open files"),
        heal=_may_open,
        drives_again=True,
    ),
)
CASES = {"camera": CAMERA}
