"""A person with a gamepad beside the robot; the device objects to what the kernel objects to."""

from __future__ import annotations

import errno
import os
import struct
from types import SimpleNamespace

import pytest

from robot.geometry import STILL
from robot.runtime.gamepad import Gamepad
from robot.safety.gates import Reason
from robot.safety.state_machine import State
from tests.robot.runtime.test_loop import Bench

LEFT_X, LEFT_Y, B, Y, LB, START = 0, 1, 1, 3, 4, 7
AXIS, BUTTON, AT_OPENING = 2, 1, 0x80


class Device:
    """/dev/input/js0 as Linux's joydev.c has it: whole events of eight bytes, ENODEV when gone."""

    def __init__(self) -> None:
        self.plugged, self.queue, self.fd = True, [], -1  # type: bool, List[bytes], int

    def open(self, path: str, flags: int) -> int:
        assert path == "/dev/input/js0"
        assert flags & os.O_NONBLOCK, "a read would wait for the next event"
        assert not flags & (os.O_WRONLY | os.O_RDWR)
        if not self.plugged:
            raise OSError(errno.ENOENT, "No such file or directory", path)
        self.fd = os.open(os.devnull, os.O_RDONLY)
        for number in range(8):
            self.event(AXIS | AT_OPENING, number, 0)
        for number in range(11):
            self.event(BUTTON | AT_OPENING, number, int(number == LB))  # held while it was opened
        return self.fd

    def read(self, fd: int, count: int) -> bytes:
        assert fd == self.fd
        if not self.plugged:
            raise OSError(errno.ENODEV, "No such device")
        if count < 8:
            raise OSError(errno.EINVAL, "Invalid argument")
        if not self.queue:
            raise BlockingIOError(errno.EAGAIN, "Resource temporarily unavailable")
        given, self.queue = self.queue[: count // 8], self.queue[count // 8 :]
        return b"".join(given)

    def event(self, kind: int, number: int, value: int) -> None:
        assert -32767 <= value <= 32767
        self.queue.append(struct.pack("=IhBB", 1234, value, kind, number))


class Person:
    """A gamepad in somebody's hands, on a bench."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.device, self.bench = Device(), Bench()
        system = {**vars(os), "open": self.device.open, "read": self.device.read}
        monkeypatch.setattr("robot.runtime.gamepad.os", SimpleNamespace(**system))
        self.pad = Gamepad("/dev/input/js0")
        self.turn()

    def turn(self, count: int = 1) -> None:
        for _ in range(count):
            self.pad.serve(self.bench.runtime.ask)
            self.bench.turn()

    def press(self, button: int, value: int = 1) -> None:
        self.device.event(BUTTON, button, value)
        self.turn()

    def push(self, x: int, y: int) -> None:
        self.device.event(AXIS, LEFT_X, x)
        self.device.event(AXIS, LEFT_Y, y)

    @property
    def state(self) -> State:
        return self.bench.state


@pytest.fixture
def person(monkeypatch: pytest.MonkeyPatch) -> Person:
    return Person(monkeypatch)


def test_the_stick_drives_only_when_armed_and_held(person: Person) -> None:
    person.push(0, -32767)
    person.turn(2)
    assert person.state is State.DISARMED, "held since before it was opened: that does not count"
    person.press(LB)
    assert person.state is State.DISARMED
    person.press(LB, 0)
    person.press(START)
    person.turn(3)
    assert person.state is State.READY
    person.press(LB)
    person.turn(2)
    assert person.state is State.MANUAL
    assert person.bench.motors.wheels == pytest.approx((0.3, 0.3))
    person.push(-32767, -16000)
    person.turn(3)
    left, right = person.bench.motors.wheels
    assert right - left == pytest.approx(2 * 0.051 * 2.4), "a hard turn to the left"
    assert 0.1 < (left + right) / 2 < 0.15


def test_the_stick_drives_back_and_to_the_right_as_well(person: Person) -> None:
    person.press(START)
    person.press(LB)
    person.push(0, 32767)
    person.turn(3)
    assert person.bench.motors.wheels == pytest.approx((-0.3, -0.3))
    person.push(32767, 0)
    person.turn(3)
    left, right = person.bench.motors.wheels
    assert left == pytest.approx(-right)
    assert left > 0.1


def test_letting_go_stops_at_once_and_holds(person: Person) -> None:
    person.press(START)
    person.push(0, -32767)
    person.press(LB)
    person.turn(5)
    person.press(LB, 0)
    person.turn()
    assert person.bench.motors.wheels == STILL
    person.turn(4)
    assert person.state is State.HOLD
    assert person.bench.safety.verdict.reason is Reason.MANUAL_STALE
    person.press(LB)
    assert person.state is State.HOLD, "only arming leads back"


def test_the_policy_is_taken_over_and_sent_again(person: Person) -> None:
    person.press(START)
    person.press(Y)
    assert person.state is State.AUTO
    person.press(LB)
    assert person.state is State.MANUAL
    person.press(Y)
    person.turn(3)
    assert person.state is State.AUTO, "though LB is still held"
    person.press(B)
    assert person.state is State.HOLD
    assert not person.bench.motors.turning


@pytest.mark.parametrize("by_hand", [True, False])
def test_who_arms_with_the_stick_pushed_and_held_drives_only_after_pressing_anew(
    person: Person, by_hand: bool
) -> None:
    person.press(START)
    person.push(0, -32767)
    person.press(LB)
    if by_hand:
        person.press(B)
    else:
        person.bench.operator.silent_s = 1.2
        person.turn()
        person.bench.operator.silent_s = 0.1
        person.turn()
    assert person.state is State.HOLD
    person.press(START)
    person.turn(2)
    assert (person.state, person.bench.motors.turning) == (State.READY, False)
    person.press(LB, 0)
    person.press(LB)
    assert person.state is State.MANUAL


def test_what_was_let_go_or_stopped_while_events_were_lost_counts(person: Person) -> None:
    """When its buffer runs over, joydev drops all of it and tells the state anew, as at opening."""
    person.press(START)
    person.push(0, -32767)
    person.press(LB)
    person.turn(2)
    assert person.state is State.MANUAL
    person.device.event(BUTTON | AT_OPENING, LB, 1)
    person.turn(2)
    assert person.state is State.MANUAL, "still held"
    person.device.event(BUTTON | AT_OPENING, LB, 0)
    person.turn()
    assert person.bench.motors.wheels == STILL
    person.device.event(BUTTON | AT_OPENING, LB, 1)
    person.turn()
    assert person.bench.motors.wheels == STILL, "who wants to drive presses it before our eyes"
    person.press(Y)
    assert person.state is State.AUTO
    for button in (Y, START):
        person.device.event(BUTTON | AT_OPENING, button, 1)
    person.device.event(BUTTON | AT_OPENING, B, 1)
    person.turn()
    assert person.state is State.HOLD


def test_a_button_that_is_let_go_or_told_anew_neither_arms_nor_drives(person: Person) -> None:
    for button in (START, Y, B):
        person.press(button)
    for button in (START, Y):
        person.press(button, 0)
        assert person.state is State.HOLD
    for button in (START, Y):
        person.device.event(BUTTON | AT_OPENING, button, 1)
        person.turn()
        assert person.state is State.HOLD


def test_where_the_stick_went_while_events_were_lost_counts(person: Person) -> None:
    person.press(START)
    person.push(0, -32767)
    person.press(LB)
    person.turn(2)
    assert person.bench.motors.turning
    person.device.event(AXIS | AT_OPENING, LEFT_Y, 0)
    person.turn(3)
    assert (person.state, person.bench.motors.wheels) == (State.MANUAL, STILL)


def test_a_pad_that_is_gone_is_a_silent_person(person: Person) -> None:
    person.press(START)
    person.push(0, -32767)
    person.press(LB)
    assert person.pad.age_s() is None
    person.device.plugged = False
    person.turn()
    assert person.pad.age_s() == float("inf")
    person.turn(4)
    assert person.state is State.HOLD
    person.device.plugged = True
    person.turn()
    assert person.pad.age_s() is None
    assert person.state is State.HOLD
    assert not person.bench.motors.turning


def test_a_flood_of_events_takes_no_turn_longer(person: Person) -> None:
    for i in range(1000):
        person.device.event(AXIS, LEFT_X, i)
    person.turn()
    assert len(person.device.queue) == 1000 - 64
    person.turn(16)
    assert not person.device.queue


def test_another_error_of_the_device_is_told(
    person: Person, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(fd: int, count: int) -> bytes:
        raise OSError(errno.EIO, "Input/output error")

    monkeypatch.setattr("robot.runtime.gamepad.os.read", broken)
    with pytest.raises(OSError, match="Input/output"):
        person.turn()


def test_a_stick_at_rest_drives_nowhere_and_leaves_it_without_a_jump(person: Person) -> None:
    person.press(START)
    person.press(LB)
    for pushed, least_mps, most_mps in ((2600, 0.0, 0.0), (3000, 0.001, 0.01), (32767, 0.3, 0.3)):
        person.push(0, -pushed)
        person.turn(3)
        assert least_mps - 1e-6 <= person.bench.motors.wheels.left_mps <= most_mps + 1e-6
    person.push(2600, 0)
    person.turn(3)
    assert person.bench.motors.wheels == STILL


@pytest.mark.parametrize("code", [errno.ENODEV, errno.ENOENT, errno.ENXIO])
def test_a_pad_that_is_gone_is_given_back_and_waited_for(
    code: int, person: Person, monkeypatch: pytest.MonkeyPatch
) -> None:
    def gone(*_: object) -> bytes:
        raise OSError(code, os.strerror(code))

    fd = person.device.fd
    with monkeypatch.context() as patch:
        patch.setattr("robot.runtime.gamepad.os.read", gone)
        patch.setattr("robot.runtime.gamepad.os.open", gone)
        person.turn(2)
        assert person.pad.age_s() == float("inf")
        with pytest.raises(OSError, match="Bad file descriptor"):
            os.fstat(fd)
    person.turn()
    assert person.pad.age_s() is None
