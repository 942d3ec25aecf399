"""One program at a time has the bus, and a thread that hangs is found out by who commands it."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any, List

import pytest

from robot.errors import HardwareError
from robot.geometry import WheelSpeeds
from robot.hat import thread as module
from robot.hat.config import HatConfig
from robot.hat.driver import MotorDriver
from robot.hat.stepper_hat import StepperHat
from robot.hat.thread import MotorThread, own_bus
from sim_pybullet.virtual.clock import VirtualClock, run_until
from sim_pybullet.virtual.hat import VirtualHat
from tests.robot.hat.rig import ALL_OFF, WatchedBus


@pytest.fixture
def opened(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> List[Any]:
    """Buses are only names here; those that were opened, and whether they were closed."""
    buses: List[Any] = []

    def open_bus(where: Any) -> Any:
        name = str(tmp_path / "i2c-1") if isinstance(where, int) else where
        bus = SimpleNamespace(name=name, where=where, closed=False)
        bus.close = lambda: setattr(bus, "closed", True)
        buses.append(bus)
        return bus

    monkeypatch.setattr(module, "open_bus", open_bus)
    return buses


@pytest.mark.parametrize("virtual", [False, True])
def test_a_bus_has_one_owner_at_a_time(opened: List[Any], tmp_path: Path, virtual: bool) -> None:
    config = HatConfig(socket=str(tmp_path / "bus") if virtual else "", bus=3)
    with own_bus(config) as bus:
        assert bus.where == (config.socket if virtual else 3)  # type: ignore[union-attr]
        with pytest.raises(HardwareError) as told, own_bus(config):
            raise AssertionError("two owners")
        assert f"{bus.name}: expected to be the only program that drives" in str(told.value)
        assert "another one has the bus; end that one first (`fuser " in str(told.value)
        assert [each.closed for each in opened] == [False, True]
    assert [each.closed for each in opened] == [True, True]
    with own_bus(config):
        pass
    (lock,) = tmp_path.iterdir()
    assert lock.name == ("bus.lock" if virtual else "i2c-1"), "a device is locked itself"
    assert lock.stat().st_mode & 0o777 == 0o600


class Hanging(MotorThread):
    """Its thread never comes to its turn."""

    def _work(self) -> None:
        self._ending.wait()


@pytest.fixture
def rig() -> Any:
    clock, bus, config = VirtualClock(), WatchedBus(), HatConfig()
    hat = VirtualHat(bus, clock)
    driver = MotorDriver(StepperHat(bus, config, clock), config, clock)
    return SimpleNamespace(motors=Hanging(driver, clock), clock=clock, bus=bus, hat=hat)


@pytest.mark.parametrize("tell", ["on_tick", "set_wheels"])
def test_a_thread_that_hangs_is_told_at_the_fourth_look_and_after_half_a_second(
    rig: Any, tell: str
) -> None:
    def look_at(now_s: float) -> None:
        rig.clock.advance_to(now_s)
        if tell == "on_tick":
            rig.motors.on_tick(None)
        else:
            rig.motors.set_wheels(WheelSpeeds(0.1, 0.1))

    with rig.motors:
        for now_s in (10.0, 10.3, 10.6):
            look_at(now_s)
        assert rig.motors.healthy
        with pytest.raises(HardwareError, match="expected a turn each time it is woken, it hangs"):
            look_at(10.61)
        assert not rig.motors.healthy
        assert not rig.hat.chip.outputs.any_high
        assert rig.bus.log[-1].data == ALL_OFF
        with pytest.raises(HardwareError, match="it hangs"):
            rig.motors.set_wheels(WheelSpeeds(0.0, 0.0))
        hung = rig.motors._thread
        rig.motors.mend()
        assert rig.motors.healthy
        assert not hung.is_alive(), "two threads would step"
        rig.motors._turns += 1
        for k in range(9):
            look_at(20.0 + 0.06 * k)  # often, but not for half a second
        with pytest.raises(HardwareError, match="it hangs"):
            look_at(20.51)


def test_a_thread_that_turns_in_between_does_not_hang(rig: Any) -> None:
    with rig.motors:
        for k in range(20):
            rig.clock.advance_to(10.0 + 0.3 * k)
            rig.motors._turns += k % 3 == 2
            rig.motors.on_tick(None)
        assert rig.motors.healthy


def test_who_commands_a_thread_that_ended_is_told(rig: Any) -> None:
    with rig.motors:
        rig.motors.end()
        for command in (rig.motors.stop, rig.motors.release, lambda: rig.motors.on_tick(None)):
            with pytest.raises(HardwareError, match="expected it to run, it has ended"):
                command()
        assert not rig.motors.healthy
        rig.motors.mend()
        rig.motors.stop()
        assert rig.motors.healthy


def test_the_thread_waits_for_the_next_deadline_and_a_moment_where_it_is_past(rig: Any) -> None:
    """Longer, steps would come late; without a moment, no other thread would come to its turn."""
    waits: List[Any] = []
    deadlines_s = iter([None, 10.02, 9.0])
    rig.clock.advance_to(10.0)
    rig.motors._driver.pump = lambda _: next(deadlines_s)
    rig.motors._alarm.wait = waits.append
    with pytest.raises(StopIteration):
        MotorThread._work(rig.motors)
    assert waits == [None, pytest.approx(0.02), 50e-6]


def test_who_is_told_to_stop_or_to_let_go_does(rig: Any) -> None:
    motors, clock = rig.motors, rig.clock
    with motors:
        for _ in range(3):
            motors.set_wheels(WheelSpeeds(0.2, 0.2))
            run_until(motors._driver, clock, clock.now() + 0.4)
        assert motors._driver.planner.deadline_s is not None
        motors.stop()
        run_until(motors._driver, clock, clock.now() + 0.16)
        assert motors._driver.planner.deadline_s is None
        assert rig.hat.chip.outputs.any_high, "the coils hold"
        clock.sleep(0.31)
        motors.release()
        assert not rig.hat.chip.outputs.any_high


def test_every_command_wakes_the_thread(rig: Any) -> None:
    rung: List[bool] = []
    with rig.motors:
        rig.motors._alarm.set = lambda: rung.append(True)
        rig.motors.set_wheels(WheelSpeeds(0.0, 0.0))
        rig.motors.stop()
        rig.motors.release()
        rig.motors.on_tick(None)
        assert len(rung) == 4
        rig.motors.end()
        assert len(rung) == 5
