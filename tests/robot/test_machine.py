"""How the robot's computer is looked at: its buses, its camera, and whom it can call."""

from __future__ import annotations

import fnmatch
import socket
from types import SimpleNamespace
from typing import List

import numpy as np
import pytest

from robot.computer.machine import Machine
from robot.config import CameraConfig
from tests.robot.camera.test_newest import FakeStream


def test_pictures_are_counted_for_as_long_as_was_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    now_s = [100.0]

    class Timed(FakeStream):
        def grab(self) -> np.ndarray:
            now_s[0] += 0.05
            return super().grab()

    stream = Timed([7] * 1000)
    clock = SimpleNamespace(monotonic=lambda: now_s[0])
    monkeypatch.setattr("robot.computer.machine.open_stream", lambda *_: stream)
    monkeypatch.setattr("robot.computer.machine.time", clock)
    look = Machine().watch(CameraConfig(), 1.98)
    assert (look.rate_hz, look.brightness) == (pytest.approx(20.0), 7.0)
    assert now_s[0] == pytest.approx(100.0 + 0.05 + 2.0), "the first is no interval"


def test_buses_are_found_by_their_whole_number(monkeypatch: pytest.MonkeyPatch) -> None:
    there = ["/dev/i2c-10", "/dev/i2c-2", "/dev/i2c", "/dev/spi-1"]
    monkeypatch.setattr("glob.glob", lambda pattern: fnmatch.filter(there, pattern))
    assert Machine().buses() == [2, 10]


def test_who_is_called_has_a_second_to_answer_and_is_let_go(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    calls: List[object] = []

    def call(*told: object) -> SimpleNamespace:
        calls.append(told)
        return SimpleNamespace(close=lambda: calls.append("closed"))

    monkeypatch.setattr("socket.create_connection", call)
    assert Machine().connects("robot.local", 5570) == ""
    assert calls == [(("robot.local", 5570), 1.0), "closed"]


@pytest.mark.parametrize(
    ("error", "says"),
    [(socket.timeout("timed out"), "timed out"), (OSError(113, "No route to host"), "No route")],
)
def test_why_nobody_answers_is_never_without_words(
    monkeypatch: pytest.MonkeyPatch, error: OSError, says: str
) -> None:
    """A timeout has no ``strerror``; no words would mean that somebody answers."""

    def call(*_: object) -> None:
        raise error

    monkeypatch.setattr("socket.create_connection", call)
    assert says in Machine().connects("robot.local", 5570)
