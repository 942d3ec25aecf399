"""A minute of the long drive: the robot's own figures do not grow."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

from tests.tools.pursuit import write_pursuit


def test_neither_threads_nor_files_grow_while_the_others_come_and_go(tmp_path: Path) -> None:
    model = write_pursuit(tmp_path / "pursuit.onnx")
    command = [sys.executable, "-m", "tests.tools.long_drive", str(model), "0.02", "12"]
    done = subprocess.run(command, stdout=subprocess.PIPE, check=True, text=True, timeout=300)
    rows = [json.loads(line) for line in done.stdout.splitlines()]
    assert len(rows) >= 5
    assert rows[-1]["missions"] >= 1
    for figure in ("threads", "python_threads", "fds"):
        values = [row[figure] for row in rows[1:]]
        half = len(values) // 2  # who has just gone or come makes single values smaller or greater
        assert min(values[half:]) <= max(values[:half]), (figure, values)
    assert rows[-1]["rss_mb"] < 200.0  # mostly libraries, whose size differs between machines


ASTRAY = """
import json, sys, time
from pathlib import Path
import tests.tools.long_drive as long_drive

clock = long_drive.FastClock()
time.monotonic, time.sleep = clock.now, clock.sleep
long_drive.FastClock = lambda: clock
from tests.tools import long_drive_parts as parts

lane = parts.start_of
starts = iter([lane("arena").moved(0.0, 1.5).moved(0.125, 0.0).moved(0.0, -1.5)])
parts.start_of = lambda name: next(starts, lane(name))
long_drive.drive(Path(sys.argv[1]), 0.01, lambda row: print(json.dumps(row)), 34.0)
"""


def test_a_robot_that_has_strayed_is_put_back(tmp_path: Path) -> None:
    model = write_pursuit(tmp_path / "pursuit.onnx")
    command = [sys.executable, "-c", ASTRAY, str(model)]
    done = subprocess.run(command, stdout=subprocess.PIPE, check=True, text=True, timeout=300)
    row = json.loads(done.stdout.splitlines()[-1])
    assert row["carried"] >= 1  # more when the new pose comes later than the next mission
    assert row["missions"] > 1


def test_wrong_arguments_end_with_status_2() -> None:
    command = [sys.executable, "-m", "tests.tools.long_drive", "model.onnx", "-1"]
    assert subprocess.run(command, stderr=subprocess.PIPE, check=False).returncode == 2
