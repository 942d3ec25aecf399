"""How much a test tries: a little in every run, all of it with ``THOROUGH=1``."""

import os

import pytest

THOROUGH = os.environ.get("THOROUGH") == "1"
only = pytest.mark.skipif(not THOROUGH, reason="long; THOROUGH=1 runs it")


def count(usual: int, thorough: int) -> int:
    """The number for this run."""
    return thorough if THOROUGH else usual
