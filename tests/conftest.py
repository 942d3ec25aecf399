"""Shared fixtures: where the reference data lies, when it is there."""

import os
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent


@pytest.fixture(scope="session")
def data_dir() -> Path:
    """The reference data (real photographs, map files, oracle figures); skips where absent."""
    path = Path(os.environ.get("DUCKPILOT_DATA", ROOT.parent / "shared" / "data"))
    if not path.is_dir():
        pytest.skip(f"no reference data at {path} (set DUCKPILOT_DATA)")
    return path
