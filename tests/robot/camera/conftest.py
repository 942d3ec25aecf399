"""What the tests of cameras share."""

import pytest

from robot.camera import source


@pytest.fixture
def quickly(monkeypatch: pytest.MonkeyPatch) -> None:
    """A stream that has ended is opened again soon."""
    monkeypatch.setattr(source, "FIRST_WAIT_S", 0.01)
