"""A program in lock-step: its threads wait for the conductor, not in real time for each other."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tools.loop import timekeeper
from tools.loop.timekeeper import START_S, Conductor

ROOT = Path(__file__).parents[2]
PROGRAM = """
import threading, time
from robot.hat.thread import MotorThread
guard, began_s, told = MotorThread(None)._guard, time.monotonic(), []
def mend():
    with guard, guard:
        time.sleep(0.01)  # as for the chip's oscillator
        told.append("mended")
def stop():
    time.sleep(0.004)
    with guard:
        told.append(f"stopped after {1e3 * (time.monotonic() - began_s):.0f} ms")
both = [threading.Thread(target=work) for work in (mend, stop)]
for each in both:
    each.start()
for each in both:
    each.join()
print(*told, sep=", ")
"""


def test_who_waits_for_motors_that_are_being_mended_lets_time_go_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The watchdog did: the mending thread slept until a time that never came."""
    monkeypatch.setattr(timekeeper, "PATIENCE_S", 20.0)
    (tmp_path / "mending.py").write_text(PROGRAM, encoding="utf-8")
    conductor = Conductor(tmp_path, ("robot",))
    command = [sys.executable, *conductor.prefix("robot"), "mending"]
    where = {**os.environ, "PYTHONPATH": f"{ROOT}:{tmp_path}"}
    with subprocess.Popen(command, env=where, stdout=subprocess.PIPE, text=True) as robot:
        try:
            conductor.joined("robot", lambda: robot.poll() is None)
            conductor.run_until(START_S + 1.0)
            said, _ = robot.communicate(timeout=20.0)
        finally:
            robot.kill()
            conductor.end()
    assert said.strip() == "mended, stopped after 10 ms"
