from __future__ import annotations

import pytest

from robot.camera.source import V4l2Stream
from robot.errors import HardwareError


def test_a_camera_that_is_not_there_is_named() -> None:
    with pytest.raises(HardwareError, match="/dev/video977: expected a camera that opens"):
        V4l2Stream(977, (320, 240), 30)
