"""Help is there at once: nobody waits for large libraries who only wants to read."""

from __future__ import annotations

import subprocess
import sys

import pytest

from robot.cli import COMMANDS

# Those that the robot uses, and that take longer to load than all of its own modules.
LARGE = {"cv2", "mcap", "onnxruntime", "scipy", "zmq"}


@pytest.mark.parametrize("command", ["", *COMMANDS])
def test_help_loads_no_large_library(command: str) -> None:
    words = [sys.executable, "-X", "importtime", "-m", "robot", *command.split(), "--help"]
    told = subprocess.run(words, check=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    assert told.stdout.startswith(b"usage")
    loaded = {line.split("|")[-1].strip() for line in told.stderr.decode().splitlines()}
    assert "robot.cli" in loaded
    assert not LARGE & {name.split(".")[0] for name in loaded}
