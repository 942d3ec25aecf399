"""A thread that keeps a driver's deadlines while the rest of the robot looks and thinks."""

from __future__ import annotations

import threading
from types import TracebackType
from typing import Optional, Type

from robot.errors import HardwareError
from robot.geometry import Pose, WheelSpeeds
from robot.hat.bus import I2cBus, SmbusBus
from robot.hat.clock import Clock, MonotonicClock
from robot.hat.config import HatConfig
from robot.hat.driver import MotorDriver
from robot.hat.socket_bus import SocketBus
from robot.hat.stepper_hat import StepperHat
from robot.hat.stepping import Steps
from robot.worker import Worker

MIN_WAIT_S = 50e-6


class MotorThread(Worker):
    """The face of a MotorDriver that any thread may use, in a ``with`` block.

    The driver's ``command_timeout_s`` stops the robot when the thread that commands it hangs. A
    fault in the background switches the coils off at once and is raised by the next call, until
    ``mend``.

    Raises:
        HardwareError: from every method, when the HAT failed.
    """

    def __init__(self, driver: MotorDriver, clock: Optional[Clock] = None) -> None:
        super().__init__("motor")
        self._driver = driver
        self._clock = clock or MonotonicClock()
        self._changed = threading.Condition()

    def __enter__(self) -> MotorThread:
        self._driver.open()
        return super().__enter__()

    def __exit__(
        self,
        kind: Optional[Type[BaseException]],
        error: Optional[BaseException],
        trace: Optional[TracebackType],
    ) -> None:
        self.end()
        self._driver.close()

    def mend(self) -> None:
        """Find the HAT again after a fault, coils off; nothing to do without one."""
        if self.healthy:
            return
        self.end()
        self._driver.open()
        self.start()

    def set_wheels(self, wheels: WheelSpeeds) -> None:
        """Aim for these rim speeds [m/s]; ContractError beyond the driver's limits."""
        with self._changed:
            self._expect_running()
            self._driver.set_wheels(wheels)
            self._changed.notify()

    def stop(self) -> None:
        """No further step, without a ramp; the coils hold."""
        with self._changed:
            self._expect_running()
            self._driver.stop()
            self._changed.notify()

    def release(self) -> None:
        """Stop and switch every output off."""
        with self._changed:
            self._expect_running()
            self._driver.release()
            self._changed.notify()

    @property
    def pose(self) -> Pose:
        """The driver's step odometry."""
        with self._changed:
            return self._driver.pose

    @pose.setter
    def pose(self, pose: Pose) -> None:
        with self._changed:
            self._driver.pose = pose

    @property
    def counts(self) -> Steps:
        """Microsteps of each wheel so far."""
        with self._changed:
            return self._driver.counts

    @property
    def healthy(self) -> bool:
        """Whether the thread runs and no fault came up."""
        return self.alive and not self._driver.failed

    def _expect_running(self) -> None:
        self.check()
        if not self.alive:
            raise HardwareError("motor thread: expected it to run, it has ended")

    def _wake(self) -> None:
        with self._changed:
            self._changed.notify()

    def _work(self) -> None:
        with self._changed:
            while not self._ending.is_set():
                self._wait_until(self._driver.pump(self._clock.now()))

    def _wait_until(self, deadline_s: Optional[float]) -> None:
        if deadline_s is None:
            self._changed.wait()
        else:
            # Waiting lets the other threads in, so it must happen even when the deadline is past.
            self._changed.wait(max(deadline_s - self._clock.now(), MIN_WAIT_S))


def real_motors(config: HatConfig) -> MotorThread:
    """The motors on the configured I2C bus; enter the result to find the HAT and start.

    Raises:
        HardwareError: there is no such bus, or this user may not use it.
    """
    clock = MonotonicClock()
    hat = StepperHat(open_bus(config), config, clock)
    return MotorThread(MotorDriver(hat, config, clock), clock)


def open_bus(config: HatConfig) -> I2cBus:
    """The configured I2C bus.

    Raises:
        HardwareError: there is no such bus, or this user may not use it.
    """
    return SocketBus(config.socket) if config.socket else SmbusBus(config.bus)
