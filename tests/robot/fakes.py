"""The parts of a robot, faked; each objects to what the real one would object to."""

from __future__ import annotations

import math
from typing import Callable, List, Optional, Tuple

import numpy as np

from robot.camera.source import Frame
from robot.contract import MAX_WHEEL_MPS, PolicyContract
from robot.errors import HardwareError
from robot.geometry import Pose, WheelSpeeds
from robot.inference.preprocess import FRAME_SHAPE
from robot.parts import Ask, Guidance, Tick
from robot.safety.state_machine import Answer, Command
from robot.vision.plausibility import Sight
from tests.robot.clocks import FakeClock
from tests.robot.tiny_onnx import lane_contract


def after(turns: int) -> Callable[[], bool]:
    """Ends a runtime after so many turns."""
    return iter([False] * turns + [True]).__next__


class FakeCamera:
    """A new picture each time it is asked, unless ``broken`` gives something else."""

    def __init__(self, clock: FakeClock) -> None:
        self._clock = clock
        self._rng = np.random.default_rng(0)
        self.sequence = 0
        self.broken: Optional[Callable[[Frame], Optional[Frame]]] = None

    def read(self) -> Optional[Frame]:
        self.sequence += 1
        image = self._rng.integers(0, 255, FRAME_SHAPE, dtype=np.uint8)
        frame = Frame(image, self.sequence, self._clock.now_s - 0.02)
        return self.broken(frame) if self.broken else frame


class FakePolicy:
    """Prefers ``best``; objects to pictures that are not those of its contract."""

    def __init__(self, clock: FakeClock, contract: Optional[PolicyContract] = None) -> None:
        self.contract = contract or lane_contract()
        self.best = 2
        self.takes_s = 0.01
        self.objections: List[str] = []
        self.told: List[Tuple[float, ...]] = []  # beside each picture
        self.broken: Optional[Callable[[np.ndarray], np.ndarray]] = None
        self._clock = clock

    def values(self, images: np.ndarray, path: Optional[np.ndarray] = None) -> np.ndarray:
        if images.shape != (1, *self.contract.image.shape) or images.dtype != np.uint8:
            self.objections.append(f"asked about {images.shape} {images.dtype}")
        wanted = self.contract.path_points + 2 * self.contract.commands
        if (path is not None) != (wanted > 0) or (path is not None and path.shape != (1, wanted)):
            self.objections.append(f"asked with path {path}")
        self.told.append(() if path is None else tuple(path[0].tolist()))
        self._clock.now_s += self.takes_s
        values = np.eye(5, dtype=np.float32)[[self.best]]
        return self.broken(values) if self.broken else values


class FakeMotors:
    """Objects to driving while nobody allows it, and to speeds beyond the motors' limit.

    ``may_move`` says whether it is allowed; ``log`` holds what was asked, newest last.
    """

    def __init__(self, may_move: Callable[[], bool]) -> None:
        self._may_move = may_move
        self.turning = False
        self.energised = False
        self.wheels = WheelSpeeds(0.0, 0.0)
        self.broken: Tuple[str, ...] = ()
        self.log: List[str] = []
        self.objections: List[str] = []

    def set_wheels(self, wheels: WheelSpeeds) -> None:
        self._note("set_wheels")
        # The runtime turns what its parts raise into faults, so objections are kept for the test.
        if not self._may_move():
            self.objections.append("driven while not allowed to move")
        if not all(math.isfinite(w) and abs(w) <= MAX_WHEEL_MPS + 1e-9 for w in wheels):
            self.objections.append(f"asked for {wheels}")
        self.wheels, self.energised = wheels, True
        self.turning = wheels != WheelSpeeds(0.0, 0.0)

    def stop(self) -> None:
        self._note("stop")
        self.turning, self.wheels = False, WheelSpeeds(0.0, 0.0)

    def release(self) -> None:
        self._note("release")
        self.turning = self.energised = False

    def mend(self) -> None:
        self._note("mend")
        self.turning = self.energised = False

    def _note(self, name: str) -> None:
        self.log.append(name)
        if name in self.broken:
            raise HardwareError(f"{name}: the bus does not answer")


class FakeNavigator:
    def __init__(self) -> None:
        self.guidance = Guidance(np.zeros(10, np.float32), pose_age_s=0.1)
        self.broken: Optional[Exception] = None

    def look(self, now_s: float) -> Guidance:
        if self.broken:
            raise self.broken
        return self.guidance


class FakeEyes:
    """Sees what the test says, and remembers what it was shown."""

    def __init__(self) -> None:
        self.sight = Sight()
        self.broken: Optional[Exception] = None
        self.shown: List[Tuple[Optional[Frame], Optional[Pose], WheelSpeeds, float]] = []

    def look(
        self, frame: Optional[Frame], pose: Optional[Pose], wheels: WheelSpeeds, now_s: float
    ) -> Sight:
        if self.broken:
            raise self.broken
        self.shown.append((frame, pose, wheels, now_s))
        return self.sight


class FakeOperator:
    """Asks what the test puts in ``wishes``, once each."""

    def __init__(self) -> None:
        self.wishes: List[Tuple[Command, Optional[WheelSpeeds]]] = []
        self.answers: List[Answer] = []
        self.silent_s: Optional[float] = 0.1
        self.broken: Optional[Exception] = None

    def serve(self, ask: Ask) -> None:
        if self.broken:
            raise self.broken
        wishes, self.wishes = self.wishes, []
        self.answers += [ask(*wish) for wish in wishes]

    def age_s(self) -> Optional[float]:
        return self.silent_s


class FakeSubscriber:
    def __init__(self) -> None:
        self.ticks: List[Tick] = []
        self.broken: Optional[Exception] = None

    def on_tick(self, tick: Tick) -> None:
        self.ticks.append(tick)
        if self.broken:
            raise self.broken
