"""The robot that the hardware tests drive: a virtual one, or with ``--robot FILE`` a real one."""

from __future__ import annotations

import time
from contextlib import ExitStack
from pathlib import Path
from typing import Iterator

import numpy as np
import pytest

from robot.computer.clock import MonotonicClock
from robot.computer.threads import Worker
from robot.config import CameraConfig, RobotConfig
from robot.hat.config import HatConfig
from robot.inference.preprocess import FRAME_SHAPE
from robot.typed_config import load_yaml

CAMERA_FPS = 30


@pytest.fixture(scope="module")
def robot(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[RobotConfig]:
    real = request.config.getoption("--robot")
    if real is not None:
        yield load_yaml(RobotConfig, real)
        return
    with ExitStack() as stack:
        yield _virtual(tmp_path_factory.mktemp("virtual"), stack)


class Shutter(Worker):
    """Lets a virtual camera take its pictures."""

    def __init__(self, moment: object) -> None:
        super().__init__("shutter")
        self._moment = moment

    def _work(self) -> None:
        while not self._ending.wait(1.0 / CAMERA_FPS):
            self._moment()  # type: ignore[operator]


def _virtual(folder: Path, stack: ExitStack) -> RobotConfig:
    """HAT with rotors and a camera behind sockets, answering in real time."""
    from sim_pybullet.virtual.hat import VirtualHat
    from sim_pybullet.virtual.i2c import VirtualI2cBus
    from tools.loop.devices import BusServer, PictureServer
    from tools.loop.timekeeper import Timekeeper

    rng = np.random.default_rng(0)
    bus = VirtualI2cBus()
    VirtualHat(bus, MonotonicClock())
    motors = BusServer(folder / "i2c", bus, lambda: None)
    see = lambda: rng.integers(0, 256, FRAME_SHAPE, dtype=np.uint8)  # noqa: E731
    camera = PictureServer(folder / "camera", see, lambda: None)
    hardware = Timekeeper()
    for service in (motors, camera):
        stack.callback(service.close)
        hardware.add_service(service)
    stack.enter_context(hardware)
    stack.enter_context(Shutter(camera.moment))
    time.sleep(0.05)
    return RobotConfig(
        "none.onnx",
        camera=CameraConfig("socket", path=str(camera.path), fps=CAMERA_FPS),
        hat=HatConfig(socket=str(motors.path)),
    )
