from __future__ import annotations

from typing import Any, List, Tuple

import cv2
import numpy as np
import pytest

from robot.camera.source import V4l2Stream
from robot.errors import ContractError, HardwareError


class FakeCapture:
    """Gives what the test says, and notes how it was set."""

    def __init__(self, *opened: int) -> None:
        self.opened, self.settings, self.released = opened, {}, False  # type: ignore[var-annotated]
        self.gives: List[Any] = []

    def isOpened(self) -> bool:
        return True

    def set(self, what: int, value: float) -> None:
        self.settings[what] = value

    def read(self) -> Tuple[bool, Any]:
        given = self.gives.pop(0)
        if isinstance(given, Exception):
            raise given
        return given

    def release(self) -> None:
        self.released = True


@pytest.fixture
def stream(monkeypatch: pytest.MonkeyPatch) -> V4l2Stream:
    monkeypatch.setattr(cv2, "VideoCapture", FakeCapture)
    return V4l2Stream(3, (320, 240), 30)


def test_a_camera_that_is_not_there_is_named() -> None:
    with pytest.raises(HardwareError, match="/dev/video977: expected a camera that opens"):
        V4l2Stream(977, (320, 240), 30)


def test_it_is_opened_as_told_and_keeps_no_queue_of_old_pictures(stream: V4l2Stream) -> None:
    capture = stream._capture
    assert capture.opened == (3, cv2.CAP_V4L2)
    assert capture.settings == {
        cv2.CAP_PROP_FRAME_WIDTH: 320,
        cv2.CAP_PROP_FRAME_HEIGHT: 240,
        cv2.CAP_PROP_FPS: 30,
        cv2.CAP_PROP_BUFFERSIZE: 1,
    }
    assert not capture.released
    stream.close()
    assert capture.released


def test_pictures_come_as_rgb(stream: V4l2Stream) -> None:
    stream._capture.gives = [(True, np.full((2, 4, 3), (3, 2, 1), np.uint8))]
    picture = stream.grab()
    assert (picture == (1, 2, 3)).all()
    assert picture.flags["C_CONTIGUOUS"]


@pytest.mark.parametrize(
    ("given", "error"),
    [
        ((False, None), HardwareError),
        ((False, np.zeros((2, 4, 3), np.uint8)), HardwareError),
        ((True, None), HardwareError),
        ((True, np.zeros((2, 4), np.uint8)), ContractError),
        (cv2.error("a damaged picture"), ContractError),
    ],
)
def test_what_is_no_picture_ends_the_stream_or_is_odd(
    stream: V4l2Stream, given: Any, error: type
) -> None:
    stream._capture.gives = [given]
    with pytest.raises(error, match="/dev/video3: expected "):
        stream.grab()
