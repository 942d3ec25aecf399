"""Shared fixtures: where the reference data lies, when it is there."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import settings

ROOT = Path(__file__).parent.parent

# The same examples on every run: a failure is then the change's own. `make explore` draws others.
# No deadline for an example: a busy computer is no failure.
settings.register_profile("repeatable", derandomize=True, deadline=None)
settings.register_profile("explore", derandomize=False, max_examples=300, deadline=None)
settings.register_profile("quick", derandomize=True, max_examples=10, deadline=None)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "repeatable"))


def pytest_addoption(parser: pytest.Parser) -> None:
    """``--robot robot.yaml``: tests/robot/hardware drives this robot instead of a virtual one."""
    parser.addoption("--robot", type=Path, help="YAML file of a real robot")


@pytest.fixture
def hears_signals() -> Iterator[None]:
    """Children hear a hang-up and an interrupt, also when the tests run under nohup."""
    before = {number: signal.getsignal(number) for number in (signal.SIGHUP, signal.SIGINT)}
    signal.signal(signal.SIGHUP, signal.SIG_DFL)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.fixture(scope="session")
def data_dir() -> Path:
    """The reference data (real photographs, map files, oracle figures); skips where absent."""
    path = Path(os.environ.get("DUCKPILOT_DATA", ROOT.parent / "shared" / "data"))
    if not path.is_dir():
        pytest.skip(f"no reference data at {path} (set DUCKPILOT_DATA)")
    return path
