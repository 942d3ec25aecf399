"""Killed at whatever moment, a recording loses its last second at most."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from robot.recording.reader import read_turns, recover_folder
from tests import thorough

SECOND = 1.0
MANY = thorough.count(12, 100)


@pytest.mark.parametrize("count", [4, pytest.param(MANY, marks=pytest.mark.slow)])
def test_a_killed_recording_loses_its_last_second_at_most(tmp_path: Path, count: int) -> None:
    command = [sys.executable, "-m", "tests.robot.recording.killed", str(tmp_path), str(count)]
    subprocess.run(command, check=True)
    lost = []
    for number in range(count):
        notes, drives = tmp_path / str(number) / "turns.txt", tmp_path / str(number) / "drives"
        times_s = [float(line.split()[1]) for line in notes.read_text().splitlines()] or [0.0]
        found = [turn for path in recover_folder(drives) for turn, _ in read_turns(path)]
        assert [turn.number for turn in found] == list(range(1, len(found) + 1)), "none between"
        lost.append(times_s[-1] - (found[-1].time_s if found else times_s[0]))
    assert max(lost) <= SECOND, sorted(lost)[-5:]
