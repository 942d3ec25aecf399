from __future__ import annotations

import contextlib
import errno
import itertools
import os
import resource
import threading
import time
from typing import Callable, List, Optional

import numpy as np
import pytest

from robot.camera.source import Frame, NewestFrame
from robot.errors import HardwareError
from robot.inference.preprocess import FRAME_SHAPE


class FakeStream:
    """Plays levels, then fails; objects to use after closing and to a second open one."""

    open_now = opened = 0

    def __init__(self, levels: List[int], wrong: Optional[Exception] = None) -> None:
        assert FakeStream.open_now == 0, "opened twice"
        FakeStream.open_now += 1
        FakeStream.opened += 1
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


@pytest.mark.usefixtures("quickly")
def test_gives_the_newest_frame_and_opens_again() -> None:
    rolls, before = [[10, 20, 30], [40, 50]], FakeStream.opened

    def open_stream() -> FakeStream:
        return FakeStream(rolls.pop(0) if rolls else [])

    with NewestFrame(open_stream, time.monotonic) as camera:
        eventually(lambda: FakeStream.opened - before > 3)
        frame = camera.read()
        assert frame is not None
        assert frame.sequence == 4
        assert int(frame.image[0, 0, 0]) == 50
        assert 0.0 <= time.monotonic() - frame.time_s < 5.0
        assert camera.problem == "unplugged"
    assert FakeStream.open_now == 0


@pytest.mark.usefixtures("quickly")
def test_before_the_first_frame_there_is_none() -> None:
    def open_stream() -> FakeStream:
        raise HardwareError("no such camera")

    with NewestFrame(open_stream, time.monotonic) as camera:
        assert camera.read() is None
        eventually(lambda: camera.problem == "no such camera")


def test_a_thread_that_dies_is_an_error_of_the_next_read() -> None:
    with NewestFrame(lambda: FakeStream([1], KeyError("bug")), time.monotonic) as camera:
        eventually(lambda: not camera.alive)
        with pytest.raises(HardwareError, match="camera thread: KeyError"):
            camera.read()


def test_a_camera_is_opened_again_after_waits_that_double_up_to_8_s_until_it_plays() -> None:
    waits: List[float] = []
    good = iter([False] * 6 + [True] + [False] * 2)

    def open_stream() -> FakeStream:
        if not next(good):
            raise HardwareError("no such camera")
        return FakeStream([5])

    def wait(timeout_s: Optional[float] = None) -> bool:
        waits.append(timeout_s or 0.0)
        if len(waits) > 8:
            camera._ending.set()
        return camera._ending.is_set()

    camera = NewestFrame(open_stream, time.monotonic)
    camera._ending.wait = wait  # type: ignore[method-assign]
    with camera:
        eventually(lambda: not camera.alive)
    assert waits == [0.5, 1.0, 2.0, 4.0, 8.0, 8.0, 0.5, 1.0, 2.0]


ODD = {
    "gray": np.zeros((120, 160), np.uint8),
    "four colours": np.zeros((120, 160, 4), np.uint8),
    "floats": np.zeros((120, 160, 3)),
    "no rows": np.zeros((0, 160, 3), np.uint8),
    "no columns": np.zeros((120, 0, 3), np.uint8),
    "one pixel": np.zeros((1, 1, 3), np.uint8),
    "none": None,
    "text": "picture",
}


@pytest.mark.parametrize("odd", list(ODD))
def test_an_odd_picture_counts_as_none_and_the_next_ones_come(odd: str) -> None:
    class Stream(FakeStream):
        given = 0

        def grab(self) -> np.ndarray:
            Stream.given += 1
            return ODD[odd] if Stream.given == 3 else super().grab()  # type: ignore[return-value]

    before = FakeStream.opened
    with NewestFrame(lambda: Stream([7] * 1000), time.monotonic) as camera:
        eventually(lambda: Stream.given > 6)
        frame = camera.read()
        assert frame is not None
        assert frame.image.shape == FRAME_SHAPE
        assert FakeStream.opened == before + 1, "the stream was not opened anew for it"
        eventually(lambda: camera.problem == "")


@pytest.mark.usefixtures("quickly")
def test_each_frame_is_dated_when_it_has_come() -> None:
    with NewestFrame(lambda: FakeStream([1, 2, 3]), itertools.count().__next__) as camera:
        eventually(lambda: (camera.read() or Frame(np.zeros(0), 0, 0.0)).sequence > 3)
        frame = camera.read()
    assert frame is not None
    assert frame.time_s == frame.sequence


def test_a_stream_of_odd_pictures_keeps_no_processor_busy_and_is_told_once(
    caplog: pytest.LogCaptureFixture,
) -> None:
    odd: List[int] = []

    class Stream(FakeStream):
        def grab(self) -> np.ndarray:
            odd.append(1)
            return np.zeros((3, 3), np.uint8)

    with NewestFrame(lambda: Stream([]), time.monotonic):
        time.sleep(0.3)
    assert 0 < len(odd) <= 32, "a hundred a second at most"
    assert len([each for each in caplog.messages if "odd picture" in each]) == 1


def test_nothing_but_odd_pictures_leave_the_last_frame_to_grow_old() -> None:
    class Stream(FakeStream):
        def grab(self) -> np.ndarray:
            return super().grab() if self._levels else np.zeros((3, 3), np.uint8)

    with NewestFrame(lambda: Stream([7, 8]), time.monotonic) as camera:
        eventually(lambda: camera.problem.startswith("odd picture: picture: expected (H, W, 3)"))
        frame = camera.read()
        assert frame is not None
        assert (frame.sequence, int(frame.image[0, 0, 0])) == (1, 8)
        time.sleep(0.05)
        assert camera.read() is frame
        assert camera.alive


@pytest.mark.usefixtures("quickly")
@pytest.mark.parametrize(
    "wrong",
    [OSError(errno.EMFILE, "Too many open files"), ValueError("cannot reshape"), MemoryError()],
)
def test_what_a_device_may_raise_ends_a_stream_and_not_the_thread(wrong: Exception) -> None:
    before = FakeStream.opened
    with NewestFrame(lambda: FakeStream([5], wrong), time.monotonic) as camera:
        eventually(lambda: FakeStream.opened - before > 2)
        assert camera.alive
        eventually(lambda: camera.problem == (str(wrong) or "MemoryError"))  # "" between streams
        assert camera.read() is not None


@pytest.mark.usefixtures("quickly")
def test_a_camera_comes_back_when_descriptors_do() -> None:
    """All are taken, so that none is left to open the device anew; then they are given back."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    playing, none_left = [FakeStream([1, 2])], threading.Event()

    def open_stream() -> FakeStream:
        if playing:
            return playing.pop()
        none_left.wait(5.0)
        os.close(os.open(os.devnull, os.O_RDONLY))
        return FakeStream([9] * 10_000)

    lowest = max(int(fd) for fd in os.listdir("/proc/self/fd")) + 1
    taken: List[int] = []
    with NewestFrame(open_stream, time.monotonic) as camera:
        try:
            resource.setrlimit(resource.RLIMIT_NOFILE, (lowest, hard))
            with contextlib.suppress(OSError):
                while True:
                    taken.append(os.dup(0))
            none_left.set()
            eventually(lambda: "Too many open files" in camera.problem)
            assert camera.alive
        finally:
            resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
            for fd in taken:
                os.close(fd)
        eventually(lambda: camera.problem == "")
        frame = camera.read()
        assert frame is not None
        assert int(frame.image[0, 0, 0]) == 9
