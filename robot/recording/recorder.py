"""Records every drive, beside the control loop and never in its way.

The loop hands over each turn without waiting; a thread compresses and writes. A queue that is full
loses turns, which are counted and told; a disk that is full ends the recording, never the drive.
"""

from __future__ import annotations

import logging
import math
import threading
import time
from collections import deque
from pathlib import Path
from typing import Callable, Deque, Optional, Tuple

from robot.alarm import Alarm
from robot.link.telemetry import Reading
from robot.parts import Tick
from robot.recording.config import RecordingConfig
from robot.recording.drive_log import Heard
from robot.recording.repair import recover_folder
from robot.recording.scribe import Scribe
from robot.recording.subject import Subject
from robot.safety.state_machine import State
from robot.worker import Worker

QUEUE_TURNS = 50  # five seconds, 3 MB: a card that tidies up takes one or two
TAIL_S = 2.0  # after the robot has come to rest
LONGEST_S = 600.0  # then the next file: the index of an open file grows
WAIT_S = 0.25
ARMED = frozenset((State.READY, State.AUTO, State.MANUAL))

logger = logging.getLogger(__name__)


class Recorder(Worker):
    """A ``Subscriber`` in a ``with`` block: one file from arming until two seconds after rest.

    Leaving the block writes what is queued and completes the file.

    Args:
        config: where to.
        subject: who drives.
        wall: time of day [s since 1970]; looked at once a file.
    """

    def __init__(
        self, config: RecordingConfig, subject: Subject, wall: Callable[[], float] = time.time
    ) -> None:
        super().__init__("recorder")
        self.dropped = 0  # turns that the queue had no room for
        self._folder = Path(config.folder)
        self._subject = subject
        self._scribe = Scribe(config, subject, wall)
        self._lock, self._news = threading.Lock(), Alarm()
        self._waiting: Deque[Tuple[int, Heard]] = deque()
        self._part = 0  # counts the files
        self._began_s = self._until_s = -math.inf

    def on_tick(self, tick: Tick) -> None:
        """Hand over this turn; returns at once.

        Raises:
            HardwareError: the thread has died, which no disk can bring about.
        """
        self.check()
        now_s, resting = tick.time_s, tick.time_s > self._until_s
        if tick.verdict.state in ARMED:
            if resting or now_s - self._began_s > LONGEST_S:
                self._part += 1
                self._began_s = now_s
            self._until_s = now_s + TAIL_S
        elif resting:
            return
        subject = self._subject
        heard = Heard(
            tick,
            subject.odometry() if subject.odometry else None,
            subject.report() if subject.report else None,
            subject.overhead() if subject.overhead else None,
        )
        with self._lock:  # held for no longer than it takes to look
            if len(self._waiting) < QUEUE_TURNS:
                self._waiting.append((self._part, heard))
            else:
                self.dropped += 1
        self._news.set()

    def reading(self) -> Reading:
        """For the robot's health: the size of the newest file, or why there is none."""
        problem, written_mb = self._scribe.problem, round(self._scribe.written_mb, 1)
        if not problem and not self.alive:
            problem = "no thread"
        if problem:
            return Reading(f"not recording: {problem}"[:24], written_mb, "MB", "bad")
        if self.dropped:
            return Reading("turns not recorded", self.dropped, "", "warn")
        return Reading("recorded", written_mb, "MB")

    def _wake(self) -> None:
        self._news.set()

    def _work(self) -> None:
        self._recover()
        part, silent_s = 0, 0.0
        while True:
            item, ending = self._next()
            silent_s = 0.0 if item is not None else silent_s + WAIT_S
            if silent_s >= TAIL_S or (item is not None and item[0] != part) or ending:
                self._scribe.end(self.dropped)
            if ending:
                return
            if item is None:
                continue
            if item[0] != part:
                part = item[0]
                self._scribe.begin(item[1].tick.time_s)
            self._scribe.write(item[1])

    def _next(self) -> Tuple[Optional[Tuple[int, Heard]], bool]:
        """The turn that waits longest, if one comes soon; and whether it is all over."""
        if not self._waiting and not self._ending.is_set():
            self._news.wait(WAIT_S)
        self._news.clear()  # before looking: what comes after rings again
        with self._lock:
            if self._waiting:
                return self._waiting.popleft(), False
            return None, self._ending.is_set()

    def _recover(self) -> None:
        try:
            for path in recover_folder(self._folder):
                logger.warning("%s had been cut off; what is left of it is whole again", path)
        except OSError as error:
            logger.warning("recordings that were cut off stay so: %s", error)
