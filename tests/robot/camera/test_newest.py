from __future__ import annotations

import time
from typing import Callable, List, Optional

import numpy as np
import pytest

from robot.camera.newest import NewestFrame
from robot.errors import HardwareError
from robot.inference.preprocess import FRAME_SHAPE


class FakeStream:
    """Plays levels, then fails; objects to use after closing and to a second open one."""

    open_now = 0

    def __init__(self, levels: List[int], wrong: Optional[Exception] = None) -> None:
        assert FakeStream.open_now == 0, "opened twice"
        FakeStream.open_now += 1
        self._levels = list(levels)
        self._wrong = wrong or HardwareError("unplugged")
        self._closed = False

    def grab(self) -> np.ndarray:
        assert not self._closed
        time.sleep(0.002)
        if not self._levels:
            raise self._wrong
        return np.full(FRAME_SHAPE, self._levels.pop(0), np.uint8)

    def close(self) -> None:
        assert not self._closed
        self._closed = True
        FakeStream.open_now -= 1


def eventually(holds: Callable[[], bool], patience_s: float = 5.0) -> None:
    deadline_s = time.monotonic() + patience_s
    while not holds():
        assert time.monotonic() < deadline_s, "waited in vain"
        time.sleep(0.002)


def test_gives_the_newest_frame_and_opens_again() -> None:
    rolls = [[10, 20, 30], [40, 50]]

    def open_stream() -> FakeStream:
        return FakeStream(rolls.pop(0) if rolls else [])

    with NewestFrame(open_stream, time.monotonic, first_wait_s=0.01) as camera:
        eventually(lambda: camera.restarts >= 3)
        frame = camera.read()
        assert frame is not None
        assert frame.sequence == 4
        assert int(frame.image[0, 0, 0]) == 50
        assert 0.0 <= time.monotonic() - frame.time_s < 5.0
        assert camera.problem == "unplugged"
    assert FakeStream.open_now == 0


def test_before_the_first_frame_there_is_none() -> None:
    def open_stream() -> FakeStream:
        raise HardwareError("no such camera")

    with NewestFrame(open_stream, time.monotonic, first_wait_s=0.01) as camera:
        assert camera.read() is None
        eventually(lambda: camera.problem == "no such camera")


def test_a_thread_that_dies_is_an_error_of_the_next_read() -> None:
    with NewestFrame(lambda: FakeStream([1], KeyError("bug")), time.monotonic) as camera:
        eventually(lambda: not camera.alive)
        with pytest.raises(HardwareError, match="camera thread: KeyError"):
            camera.read()
