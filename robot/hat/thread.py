"""A thread that keeps a driver's deadlines, and the bus for one program at a time.

Two programs that drive one HAT would take turns at its coils. So whoever drives holds the bus by
``flock``, which the kernel gives back whatever ends the program. Looking (``robot doctor``) and
switching off (``robot off``) need not own it.
"""

import fcntl
import os
from contextlib import ExitStack, contextmanager
from threading import RLock
from typing import Iterator, Optional, Union

from robot.computer.clock import Alarm, Clock, MonotonicClock
from robot.computer.threads import Silence, Worker
from robot.errors import HardwareError
from robot.geometry import Pose, WheelSpeeds
from robot.hat.bus import I2cBus, SmbusBus, SocketBus, open_bus
from robot.hat.config import HatConfig
from robot.hat.driver import MotorDriver
from robot.hat.stepper_hat import StepperHat
from robot.hat.stepping import Steps


@contextmanager
def own_bus(config: HatConfig) -> Iterator[Union[SmbusBus, SocketBus]]:
    """The configured I2C bus, ours alone; HardwareError where there is none, or it is another's."""
    with ExitStack() as stack:
        bus = open_bus(config.socket or config.bus)
        stack.callback(bus.close)
        # A device is locked itself, so that nothing is left behind; a socket cannot be opened.
        path = f"{bus.name}.lock" if config.socket else bus.name
        lock = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
        stack.callback(os.close, lock)
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            raise HardwareError(
                f"{bus.name}: expected to be the only program that drives, another one has the bus;"
                f" end that one first (`fuser {path}` tells which; `robot off` switches it off)"
            ) from error
        yield bus


MIN_WAIT_S = 50e-6
WAKINGS, TURN_S = 3, 0.5  # by commands and turns of the loop; without a turn in between it hangs


class MotorThread(Worker):
    """The face of a MotorDriver that any thread may use, in a ``with`` block.

    The driver's ``command_timeout_s`` stops the robot when the thread that commands it hangs; when
    this thread hangs, the one that commands it switches the coils off. A fault in the background
    switches them off at once and is raised by the next call, until ``mend``. As a ``Subscriber`` it
    tells of that without a command, too. HardwareError: from every method, when the HAT failed.
    """

    def __init__(self, driver: MotorDriver, clock: Optional[Clock] = None) -> None:
        super().__init__("motor")
        self._driver = driver
        self._clock = clock or MonotonicClock()
        self._guard = RLock()  # of the driver
        self._alarm = Alarm()
        self._turns = 0
        self._silence = Silence(WAKINGS, TURN_S)

    def __enter__(self) -> "MotorThread":
        self._driver.open()
        return super().__enter__()

    def __exit__(self, *_: object) -> None:
        try:
            self.end()
        finally:  # also when a second Ctrl-C cuts the wait short
            with self._guard:
                self._driver.close()

    def mend(self) -> None:
        """Find the HAT again after a fault, coils off; nothing to do without one."""
        if not self.healthy:
            self.end()
            with self._guard:  # of who watches meanwhile
                self._driver.open()
                self.start()

    def set_wheels(self, wheels: WheelSpeeds) -> None:
        """Aim for these rim speeds [m/s]; ContractError beyond the driver's limits."""
        with self._commanding():
            self._expect_turning()
            self._driver.set_wheels(wheels)

    def stop(self) -> None:
        """No further step, without a ramp; the coils hold."""
        with self._commanding():
            self._driver.stop()

    def release(self) -> None:
        """Stop and switch every output off."""
        with self._commanding():
            self._driver.release()

    @property
    def pose(self) -> Pose:
        """The driver's step odometry."""
        with self._guard:
            return self._driver.pose

    @property
    def counts(self) -> Steps:
        """Microsteps of each wheel so far."""
        with self._guard:
            return self._driver.planner.counts

    @property
    def healthy(self) -> bool:
        """Whether the thread runs and no fault came up."""
        return self.alive and self._driver.fault is None

    def on_tick(self, tick: object) -> None:  # noqa: ARG002  every turn counts
        """HardwareError when the thread has died or hangs; then the coils are off."""
        with self._commanding():
            self._expect_turning()

    @contextmanager
    def _commanding(self) -> Iterator[None]:
        with self._guard:
            if not self.alive:
                told = f"motor thread: expected it to run, it has ended: {self._died!r}"
                self.check() if self._driver.fault else self._driver.fail(HardwareError(told))
                raise HardwareError(told)
            yield
        self._alarm.set()

    def _expect_turning(self) -> None:
        if self._silence.lasts(self._turns, self._clock.now()):
            told = "motor thread: expected a turn each time it is woken, it hangs"
            self._driver.fail(HardwareError(told))

    def _wake(self) -> None:
        self._alarm.set()

    def _work(self) -> None:
        while True:
            self._alarm.clear()  # before looking: what comes after rings again
            if self._ending.is_set():
                return
            with self._guard:
                deadline_s = self._driver.pump(self._clock.now())
                self._turns += 1
            # Waiting lets the other threads in, so it must happen even when the deadline is past.
            wait_s = None if deadline_s is None else deadline_s - self._clock.now()
            self._alarm.wait(None if wait_s is None else max(wait_s, MIN_WAIT_S))


@contextmanager
def real_motors(config: HatConfig) -> Iterator[MotorThread]:
    """The motors on the configured bus, ours meanwhile; errors as ``own_bus``, or no HAT."""
    with own_bus(config) as bus, motors_on(bus, config) as motors:
        yield motors


def motors_on(bus: I2cBus, config: HatConfig) -> MotorThread:
    """The motors on this bus; enter the result to find the HAT and start."""
    clock = MonotonicClock()
    return MotorThread(MotorDriver(StepperHat(bus, config, clock), config, clock), clock)
