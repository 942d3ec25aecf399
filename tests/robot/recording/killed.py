"""``python -m tests.robot.recording.killed FOLDER COUNT``: robots that record are killed.

Each drives in a process of its own, forked from one that has loaded everything, and notes every
turn in ``FOLDER/N.txt`` before it hands it to the recorder.
"""

from __future__ import annotations

import math
import os
import random
import signal
import sys
import time
from pathlib import Path
from typing import Callable, Dict, List

from robot.config import RecordingConfig
from robot.recording.recorder import Recorder
from robot.safety.state_machine import Command
from tests.robot.recording.drives import Robot

AT_ONCE = 4
LONGEST_S = 3.0


def drive(folder: Path) -> None:
    """Drive and record for ever, in real time, fed as the robot's loop feeds the recorder."""
    robot = Robot(folder / "model")
    notes = os.open(str(folder / "turns.txt"), os.O_WRONLY | os.O_CREAT)
    with Recorder(RecordingConfig(str(folder / "drives"), 0.0), robot.subject()) as recorder:
        for number in range(10_000):
            if number == 1:
                robot.ask(Command.ARM)
                robot.ask(Command.AUTO)
            began_s = robot.clock.now_s
            tick = robot.turn()
            os.write(notes, f"{tick.number} {tick.time_s}\n".encode())
            recorder.on_tick(tick)
            time.sleep(robot.clock.now_s - began_s)


def kill_at(
    moments_s: List[float],
    work: Callable[[int], None],
    begun: Callable[[int], bool] = lambda number: True,
) -> None:
    """Fork a process a moment, several at once, and kill each that long after it has begun [s]."""
    waiting = list(enumerate(moments_s))
    running: Dict[int, int] = {}
    ends_s: Dict[int, float] = {}
    while waiting or running:
        while waiting and len(running) < AT_ONCE:
            number, _ = waiting.pop()
            running[number] = os.fork()
            if not running[number]:
                work(number)
                os._exit(0)
        for number, child in list(running.items()):
            if number not in ends_s and begun(number):
                ends_s[number] = time.monotonic() + moments_s[number]
            if time.monotonic() >= ends_s.get(number, math.inf):
                os.kill(child, signal.SIGKILL)
                os.waitpid(child, 0)
                del running[number]
        time.sleep(0.002)


if __name__ == "__main__":
    place, count = Path(sys.argv[1]), int(sys.argv[2])
    rng = random.Random(count)
    kill_at(
        [rng.uniform(0.0, LONGEST_S) for _ in range(count)],
        lambda number: drive(place / str(number)),
        lambda number: bool((place / str(number) / "turns.txt").exists()),
    )
