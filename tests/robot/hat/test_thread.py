import time
from threading import Thread
from typing import Callable, Tuple

import pytest

from robot.computer.clock import MonotonicClock
from robot.errors import HardwareError
from robot.geometry import Pose, WheelSpeeds
from robot.hat.config import HatConfig
from robot.hat.driver import MotorDriver
from robot.hat.stepper_hat import StepperHat
from robot.hat.thread import MotorThread, real_motors
from sim_pybullet.virtual.hat import VirtualHat
from sim_pybullet.virtual.i2c import BusFault
from tests.robot.hat.rig import ALL_OFF, WatchedBus, speeds


@pytest.fixture
def parts() -> Tuple[MotorThread, WatchedBus, VirtualHat]:
    clock, bus, config = MonotonicClock(), WatchedBus(), HatConfig()
    hat = VirtualHat(bus, clock)
    driver = MotorDriver(StepperHat(bus, config, clock), config, clock)
    return MotorThread(driver), bus, hat


def wait_for_motion(motors: MotorThread) -> None:
    """Command slow driving as often as a runtime does, until a wheel has stepped."""
    before = motors.counts

    def moved() -> bool:
        motors.set_wheels(WheelSpeeds(0.1, 0.1))
        return motors.counts[0] > before[0] + 2

    wait_for(moved)


def wait_for(condition: Callable[[], bool]) -> None:
    end_s = time.monotonic() + 5.0
    while not condition():
        assert time.monotonic() < end_s
        time.sleep(0.01)


def test_the_thread_drives_in_real_time_and_stops_when_no_longer_told(parts: tuple) -> None:
    motors, bus, hat = parts
    with motors:
        motors._driver.pose = Pose(1.0, 0.0, 0.0)
        wait_for_motion(motors)
        wait_for(lambda: motors.pose.x_m > 1.005)
        wait_for(lambda: speeds(motors._driver.planner, time.monotonic()) == (0.0, 0.0))
        assert motors.healthy
        assert hat.wheel_angles_rad.min() > 0.1
    assert bus.log[-1].data == ALL_OFF


def test_an_end_that_comes_while_the_thread_looks_for_one_is_not_missed(parts: tuple) -> None:
    motors, _, _ = parts
    clear = motors._alarm.clear

    def end_then_clear() -> None:
        motors._ending.set()  # as ``end`` does, at the worst moment
        motors._wake()
        clear()

    motors._driver.open()
    motors._alarm.clear = end_then_clear
    motors.start()
    wait_for(lambda: not motors.alive)
    motors.end()


def test_a_fault_in_the_background_reaches_the_next_caller(parts: tuple) -> None:
    motors, bus, _ = parts
    with motors:
        wait_for_motion(motors)
        bus.inject(BusFault.NACK)
        wait_for(lambda: not motors.healthy)
        assert bus.log[-1].data == ALL_OFF
        for call in (motors.stop, motors.release, lambda: motors.set_wheels(WheelSpeeds(0, 0))):
            with pytest.raises(HardwareError, match="check the HAT's seat"):
                call()


def test_a_thread_that_dies_anywhere_leaves_no_coil_on(parts: tuple) -> None:
    motors, bus, _ = parts

    def die(_: object) -> None:
        raise MemoryError

    with motors:
        wait_for_motion(motors)
        motors._alarm.wait = die
        motors.stop()
        wait_for(lambda: not motors.alive)
        assert bus.log[-1].data != ALL_OFF
        with pytest.raises(HardwareError, match="it has ended: MemoryError"):
            motors.on_tick(None)
        assert bus.log[-1].data == ALL_OFF
        for call in (motors.stop, motors.release, lambda: motors.on_tick(None)):
            with pytest.raises(HardwareError, match="MemoryError"):
                call()


def test_a_mended_bus_drives_again_without_a_new_start(parts: tuple) -> None:
    motors, bus, _ = parts
    with motors:
        wait_for_motion(motors)
        bus.inject(BusFault.NACK, 10**6)
        wait_for(lambda: not motors.healthy)
        with pytest.raises(HardwareError, match="cut the motor supply"):
            motors.mend()
        with pytest.raises(HardwareError):
            motors.set_wheels(WheelSpeeds(0.1, 0.1))
        bus.mend()
        motors.mend()
        assert motors.healthy
        before = motors.counts
        time.sleep(0.1)
        assert motors.counts == before, "mending moves nothing"
        wait_for_motion(motors)
        motors.mend()  # nothing to do
        assert motors.healthy
    assert bus.log[-1].data == ALL_OFF


def test_who_watches_leaves_a_hat_alone_that_is_being_mended(parts: tuple) -> None:
    """For some milliseconds there is neither a thread nor a fault."""
    motors, bus, _ = parts
    with motors:
        wait_for_motion(motors)
        bus.inject(BusFault.NACK)
        wait_for(lambda: not motors.healthy)
        open_hat, watcher = motors._driver.open, Thread(target=motors.stop)

        def slowly() -> None:
            open_hat()
            watcher.start()
            watcher.join(0.2)

        motors._driver.open = slowly
        motors.mend()
        watcher.join()
        assert motors.healthy
        wait_for_motion(motors)


def test_an_absent_bus_is_told_before_anything_starts() -> None:
    motors = real_motors(HatConfig(bus=250))
    with pytest.raises(HardwareError, match="/dev/i2c-250: expected an I2C bus"):
        motors.__enter__()
