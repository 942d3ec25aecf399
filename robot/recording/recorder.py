"""Records every drive, beside the control loop and never in its way.

The loop hands over each turn without waiting; a thread compresses and writes. A queue that is full
loses turns, which are counted and told; a disk that is full ends the recording, never the drive.
"""

from __future__ import annotations

import errno
import itertools
import logging
import math
import shutil
import threading
import time
from collections import deque
from datetime import datetime
from pathlib import Path
from typing import Callable, Deque, Optional, Tuple

from robot.computer.clock import Alarm
from robot.computer.threads import Worker
from robot.config import RecordingConfig
from robot.link.telemetry import Reading
from robot.parts import Tick
from robot.recording.drive_file import (
    END,
    SUFFIX,
    UNFINISHED,
    DriveFile,
    DriveLog,
    Heard,
    Subject,
)
from robot.recording.reader import recover_folder
from robot.safety.state_machine import State

FLUSH_S = 0.5  # what a power cut can take
MB = 1e6
FULL = (errno.ENOSPC, errno.EDQUOT)

logger = logging.getLogger(__name__)


class DriveWriter:
    """For one thread. A drive that could not be recorded does not hinder the next."""

    def __init__(
        self, config: RecordingConfig, subject: Subject, wall: Callable[[], float]
    ) -> None:
        self.problem = ""  # why the newest drive is not recorded
        self.written_mb = 0.0  # of the newest drive
        self._config, self._subject, self._wall = config, subject, wall
        self._folder = Path(config.folder)
        self._log: Optional[DriveLog] = None
        self._flushed_s = 0.0

    def begin(self, time_s: float) -> None:
        """A drive begins; ``time_s`` [s] is now by the robot's clock."""
        self.problem, self.written_mb = "", 0.0
        wall_s = self._wall()
        began = datetime.fromtimestamp(wall_s).astimezone().isoformat(timespec="seconds")
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            self._require_room()
            file = DriveFile(self._free_path(wall_s), {**self._subject.about, "began": began})
            self._log = DriveLog(file, wall_s - time_s, self._subject.models)
        except OSError as error:
            self._give_up(error)
            return
        self._flushed_s = time.monotonic()

    def write(self, heard: Heard) -> None:
        """Add a turn to the drive."""
        log = self._log
        if log is None:
            return
        try:
            log.write(heard)
            if time.monotonic() - self._flushed_s >= FLUSH_S:
                self.written_mb = log.file.flush() / MB
                self._require_room()
                self._flushed_s = time.monotonic()
        except OSError as error:
            self._give_up(error)

    def end(self, dropped: int) -> None:
        """The drive is over; ``dropped`` turns never came here."""
        log, self._log = self._log, None
        if log is None:
            return
        try:
            log.file.note(END, {"dropped": str(dropped), "phase": log.phase})
            self.written_mb = log.file.close() / MB
        except OSError as error:
            log.file.abandon()
            self._give_up(error)

    def _give_up(self, error: OSError) -> None:
        self.problem = "disk full" if error.errno in FULL else (error.strerror or str(error))
        logger.error("this drive is not recorded any further: %s", error)
        if self._log is not None:
            self._log.file.abandon()
            self._log = None

    def _require_room(self) -> None:
        free_mb = shutil.disk_usage(self._folder).free / MB
        if free_mb < self._config.keep_free_mb:
            raise OSError(
                errno.ENOSPC,
                f"expected {self._config.keep_free_mb:.0f} MB to stay free, {free_mb:.0f} MB are; "
                f"move recordings away from {self._folder}",
            )

    def _free_path(self, wall_s: float) -> Path:
        """A name that no recording has: a robot's clock may well have stood still."""
        stem = f"{datetime.fromtimestamp(wall_s):%Y%m%d-%H%M%S}-{self._subject.about['robot']}"
        names = (stem if not number else f"{stem}-{number}" for number in itertools.count())
        paths = (self._folder / f"{name}{SUFFIX}" for name in names)
        return next(p for p in paths if not (p.exists() or p.with_suffix(UNFINISHED).exists()))


QUEUE_TURNS = 50  # five seconds, 3 MB: a card that tidies up takes one or two
TAIL_S = 2.0  # after the robot has come to rest
LONGEST_S = 600.0  # then the next file: the index of an open file grows
WAIT_S = 0.25
ARMED = frozenset((State.READY, State.AUTO, State.MANUAL))


class Recorder(Worker):
    """A ``Subscriber`` in a ``with`` block: one file from arming until two seconds after rest.

    Leaving the block writes what is queued and completes the file. ``wall`` is the time of day
    [s since 1970], looked at once a file.
    """

    def __init__(
        self, config: RecordingConfig, subject: Subject, wall: Callable[[], float] = time.time
    ) -> None:
        super().__init__("recorder")
        self.dropped = 0  # turns that the queue had no room for
        self._folder = Path(config.folder)
        self._subject = subject
        self._writer = DriveWriter(config, subject, wall)
        self._lock, self._news = threading.Lock(), Alarm()
        self._waiting: Deque[Tuple[int, Heard]] = deque()
        self._part = 0  # counts the files
        self._began_s = self._until_s = -math.inf

    def on_tick(self, tick: Tick) -> None:
        """Hand over this turn; returns at once.

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
        heard = self._subject.hear(tick)
        with self._lock:  # held for no longer than it takes to look
            if len(self._waiting) < QUEUE_TURNS:
                self._waiting.append((self._part, heard))
            else:
                self.dropped += 1
        self._news.set()

    def reading(self) -> Reading:
        """For the robot's health: the size of the newest file, or why there is none."""
        problem, written_mb = self._writer.problem, round(self._writer.written_mb, 1)
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
                self._writer.end(self.dropped)
            if ending:
                return
            if item is None:
                continue
            if item[0] != part:
                part = item[0]
                self._writer.begin(item[1].tick.time_s)
            self._writer.write(item[1])

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
