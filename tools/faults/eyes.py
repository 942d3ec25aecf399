"""The robot's camera: silent, frozen, slow, garbage; and pictures that are of no use."""

from __future__ import annotations

import resource

from tools.faults import spoil
from tools.faults.case import HOLD_OR_FAULT, Act, Case, change
from tools.faults.stage import Stage
from tools.loop.devices import PictureServer
from tools.loop.town import CAMERA_FPS

FRAME_AGE_S = 0.2
FROZEN_S = 0.6  # five frames more with the same bytes, at the rate of decisions
SLOW_HZ = 3.0
# One bare colour may be taken for a frozen picture first; where a wrong picture has led the robot
# off its path first, that is as good.
BLIND = (0.5, "lens covered|same picture", ("FAULT",))
STILL = (1.5, "has not moved|left its planned path", HOLD_OR_FAULT)
WRONG = (2.0, "road lies|left its planned path", HOLD_OR_FAULT)
LIKE_A_BEND = (6.0, *WRONG[1:])


def _camera(stage: Stage) -> PictureServer:
    return stage.bench.town.camera


def _rate(hz: float) -> Act:
    return change(lambda stage: stage.bench.town.camera_event, period_s=1.0 / hz)


def _broken(name: str, what: str, fault: str) -> Case:
    heal = change(_camera, fault="")
    return Case(name, what, change(_camera, fault=fault), FRAME_AGE_S, "frame", heal=heal)


def _may_open(stage: Stage, most: int | None = None) -> None:
    """The robot may have so many files open, or as many as it can."""
    robot = stage.bench.processes["robot"]
    if robot.alive:
        _, limit = resource.prlimit(robot.child.pid, resource.RLIMIT_NOFILE)
        soft = limit if most is None else most
        resource.prlimit(robot.child.pid, resource.RLIMIT_NOFILE, (soft, limit))


def _no_descriptors(stage: Stage) -> None:
    _may_open(stage, 3)
    _camera(stage).hang_up()


SAME = change(_camera, fault="freeze")
WELL = change(_camera, fault="")
ODD = change(_camera, fault="size", fault_ends=True)
CAMERA = (
    _broken("stops", "no picture any more", "stop"),
    Case(
        *("freezes", "new pictures, each with the bytes of the last", SAME),
        *(FROZEN_S, "same picture"),
        heal=WELL,
    ),
    Case(
        *("slows", f"{SLOW_HZ:g} pictures a second", _rate(SLOW_HZ), FRAME_AGE_S, "frame"),
        heal=_rate(CAMERA_FPS),
    ),
    _broken("wrong size", "80 x 60 px", "size"),
    _broken("garbage", "bytes that are none", "garbage"),
    Case("one odd picture", "80 x 60 px, once", ODD, states=()),
    Case(
        *("no descriptors", "and the camera must be opened anew", _no_descriptors),
        *(FRAME_AGE_S, "frame|Too many open files"),
        heal=_may_open,
        drives_again=True,
    ),
)


def _spoiled(
    name: str, what: str, wrong: spoil.Spoil, met: tuple[float, str, tuple[str, ...]]
) -> Case:
    heal = change(_camera, spoil=None)
    return Case(name, what, change(_camera, spoil=wrong), *met, heal=heal)


def _held(stage: Stage) -> None:
    _camera(stage).spoil = spoil.held()


def _shortly(name: str, what: str, wrong: spoil.Spoil, pictures: int) -> Case:
    def inject(stage: Stage) -> None:
        _camera(stage).spoil = spoil.shortly(wrong, pictures)

    return Case(name, what, inject, states=(), heal=change(_camera, spoil=None))


PICTURES = (
    _spoiled("black", "lens covered: black", spoil.covered(0), BLIND),
    _spoiled("black, noise", "lens covered: noise of 12 levels", spoil.covered(0, 12), BLIND),
    _spoiled("white", "a lamp before the lens: white", spoil.covered(255), BLIND),
    _spoiled("white, noise", "white with noise of 12 levels", spoil.covered(255, 12), BLIND),
    _spoiled("grey", "nothing but grey", spoil.covered(128), BLIND),
    _spoiled("noise", "nothing but noise, each pixel", spoil.covered(128, 90), BLIND),
    _spoiled("coarse noise", "nothing but noise in grains of 8 px", spoil.grains, BLIND),
    _spoiled("finger", "a finger before the lens: dark red", spoil.finger, BLIND),
    _spoiled("mirrored", "left and right exchanged", spoil.mirrored, WRONG),
    _spoiled("upside down", "turned by 180 degrees", spoil.upside_down, WRONG),
    _spoiled("sheared", "each row a pixel farther to the right", spoil.sheared, WRONG),
    _spoiled("rolled", "turned by 30 degrees: a camera came loose", spoil.rolled, LIKE_A_BEND),
    _spoiled("shifted", "a quarter of its width to the right", spoil.shifted, LIKE_A_BEND),
    Case(
        *("held", "the same picture with noise of 6 levels", _held, *STILL),
        heal=change(_camera, spoil=None),
    ),
    _shortly("glare", "white for 0.2 s: it must drive on", spoil.covered(255), 3),
    _shortly(
        "one odd picture", "noise in one picture: it must drive on", spoil.covered(128, 90), 1
    ),
)
CASES = {"camera": CAMERA, "pictures": PICTURES}
