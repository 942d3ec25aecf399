"""Help is there at once: nobody waits for numpy who only wants to read."""

from __future__ import annotations

import os
import resource
import subprocess
import sys

import pytest

from robot.cli import COMMANDS

LIMIT_S = 0.5  # of the processor


@pytest.mark.skipif(sys.version_info < (3, 11), reason="a promise for newer Pythons")
@pytest.mark.parametrize("command", ["", *COMMANDS])
def test_help_takes_less_than_half_a_second_of_the_processor(command: str) -> None:
    words = [sys.executable, "-m", "robot", *command.split(), "--help"]
    least_s = min(cpu_s(words) for _ in range(2))
    assert least_s < LIMIT_S


def cpu_s(words: list) -> float:
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    told = subprocess.run(words, check=True, stdout=subprocess.PIPE, env=os.environ).stdout
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    assert told.startswith(b"usage")
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
