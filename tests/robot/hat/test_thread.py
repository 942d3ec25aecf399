import time
from contextlib import suppress
from threading import Event, RLock, Thread
from typing import Callable, Optional, Tuple

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


def test_the_end_wakes_a_thread_that_waits_for_nothing(parts: tuple) -> None:
    motors, _, _ = parts
    with motors:
        motors.release()
        wait_for(lambda: motors._turns > 1)
        time.sleep(0.05)
        ending = Thread(target=motors.end, daemon=True)
        ending.start()
        ending.join(3.0)
        ended = not ending.is_alive()
        motors._alarm.set()  # so that no fault hangs the tests
    assert ended


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
        thread = motors._thread
        motors.mend()  # nothing to do
        assert motors.healthy
        assert motors._thread is thread
    assert bus.log[-1].data == ALL_OFF


def test_mending_switches_off_what_a_thread_that_ended_left_on(parts: tuple) -> None:
    motors, _, hat = parts
    with motors:
        wait_for_motion(motors)
        motors.end()
        assert hat.chip.outputs.any_high
        motors.mend()
        assert not hat.chip.outputs.any_high


@pytest.mark.parametrize("step", ["open", "start"])
def test_who_watches_leaves_a_hat_alone_that_is_being_mended(parts: tuple, step: str) -> None:
    """For some milliseconds there is neither a thread nor a fault."""
    motors, bus, _ = parts
    whose = motors._driver if step == "open" else motors
    with motors:
        wait_for_motion(motors)
        bus.inject(BusFault.NACK)
        wait_for(lambda: not motors.healthy)
        do, watcher = getattr(whose, step), Thread(target=motors.stop)

        def slowly() -> None:
            if step == "open":
                do()
            watcher.start()
            watcher.join(0.2)
            if step == "start":
                do()

        setattr(whose, step, slowly)
        motors.mend()
        watcher.join()
        assert motors.healthy
        wait_for_motion(motors)


@pytest.mark.parametrize("again", [False, True])
def test_coils_go_off_when_the_thread_has_made_its_last_step(parts: tuple, again: bool) -> None:
    """Else it could switch them on behind the last word; and Ctrl-C may come again meanwhile."""
    motors, bus, hat = parts
    pump, close, pumping, clashes = motors._driver.pump, motors._driver.close, Event(), []

    def slowly(now_s: float) -> Optional[float]:
        pumping.set()
        time.sleep(0.1)
        deadline_s = pump(now_s)
        pumping.clear()
        return deadline_s

    def look_and_close() -> None:
        clashes.append(pumping.is_set() or (motors.alive and not again))
        close()

    def interrupted(_: object) -> bool:
        raise KeyboardInterrupt

    with suppress(KeyboardInterrupt), motors:
        wait_for_motion(motors)
        motors._driver.pump, motors._driver.close = slowly, look_and_close
        if again:
            motors._ended.wait = interrupted
        assert pumping.wait(5.0)
    assert clashes == [False]
    assert bus.log[-1].data == ALL_OFF
    assert not hat.chip.outputs.any_high


def test_thread_and_commands_take_turns_at_the_driver(parts: tuple) -> None:
    motors, _, _ = parts
    turn, clashes = RLock(), []

    def alone(name: str) -> None:
        do = getattr(motors._driver, name)

        def call(*told: object) -> object:
            if not turn.acquire(blocking=False):
                clashes.append(name)
                return None
            try:
                time.sleep(0.005)
                return do(*told)
            finally:
                turn.release()

        setattr(motors._driver, name, call)

    for name in ("pump", "set_wheels", "stop", "release"):
        alone(name)
    with motors:
        for _ in range(10):
            motors.set_wheels(WheelSpeeds(0.1, 0.1))
            motors.stop()
            motors.release()
    assert clashes == []


def test_without_a_hat_no_thread_is_left_behind(parts: tuple) -> None:
    motors, bus, _ = parts
    bus.inject(BusFault.NACK, 10**6)
    with pytest.raises(HardwareError):
        motors.__enter__()
    assert not motors.alive


def test_an_absent_bus_is_told_before_anything_starts() -> None:
    motors = real_motors(HatConfig(bus=250))
    with pytest.raises(HardwareError, match="/dev/i2c-250: expected an I2C bus"):
        motors.__enter__()
