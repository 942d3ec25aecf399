"""Records every drive, beside the control loop and never in its way (docs/recording.md)."""

import errno
import itertools
import logging
import math
import shutil
import time
from collections import deque
from datetime import datetime
from pathlib import Path
from typing import Any, Callable, Deque, Optional, Tuple

from robot.computer.threads import Worker
from robot.config import RecordingConfig
from robot.link.messages import Reading
from robot.parts import Tick
from robot.recording.drive_file import END, SUFFIX, UNFINISHED, DriveFile, DriveLog, Heard, Subject
from robot.recording.reader import recover_folder
from robot.safety.state_machine import State

FLUSH_S = 0.5  # what a power cut can take
MB = 1e6
FULL = (errno.ENOSPC, errno.EDQUOT)
QUEUE_TURNS = 50  # five seconds, 3 MB: a card that tidies up takes one or two
TAIL_S = 2.0  # after the robot has come to rest
LONGEST_S = 600.0  # then the next file: the index of an open file grows
WAIT_S = 0.05
ARMED = frozenset((State.READY, State.AUTO, State.MANUAL))

logger = logging.getLogger(__name__)


class Recorder(Worker):
    """A ``Subscriber`` in a ``with`` block: one file from arming until two seconds after rest.

    Leaving the block writes what is queued and completes the file. A drive that could not be
    recorded does not hinder the next. ``wall`` is the time of day [s since 1970], looked at once a
    file.
    """

    def __init__(
        self, config: RecordingConfig, subject: Subject, wall: Callable[[], float] = time.time
    ) -> None:
        super().__init__("recorder")
        self.dropped = 0  # turns that the queue had no room for
        self._config, self._subject, self._wall = config, subject, wall
        self._folder = Path(config.folder)
        self._waiting: Deque[Tuple[int, Heard]] = deque()
        self._part = 0  # counts the files
        self._began_s = self._until_s = -math.inf
        self._log: Optional[DriveLog] = None  # the thread's, as what follows
        self._problem = ""  # why the newest drive is not recorded
        self._written_mb = self._flushed_s = 0.0  # of the newest drive

    def on_tick(self, tick: Tick) -> None:
        """Hand over this turn, at once; HardwareError where the thread died, not by any disk."""
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
        if len(self._waiting) < QUEUE_TURNS:
            self._waiting.append((self._part, heard))
        else:
            self.dropped += 1

    def reading(self) -> Reading:
        """For the robot's health: the size of the newest file, or why there is none."""
        written_mb = round(self._written_mb, 1)
        problem = self._problem or ("" if self.alive else "no thread")
        if problem:
            return Reading(f"not recording: {problem}"[:24], written_mb, "MB", "bad")
        if self.dropped:
            return Reading("turns not recorded", self.dropped, "", "warn")
        return Reading("recorded", written_mb, "MB")

    def _work(self) -> None:
        try:
            for path in recover_folder(self._folder):
                logger.warning("%s had been cut off; what is left of it is whole again", path)
        except OSError as error:
            logger.warning("recordings that were cut off stay so: %s", error)
        part, silent_s = 0, 0.0
        while True:
            ending = self._ending.is_set()  # before looking: what came before it is written
            if self._waiting:
                number, heard = self._waiting.popleft()
                if number != part:
                    self._try(self._end)
                    self._try(self._begin, heard.tick.time_s)
                self._try(self._write, heard)
                part, silent_s = number, 0.0
                continue
            if ending or silent_s >= TAIL_S:
                self._try(self._end)
            if ending:
                return
            self._ending.wait(WAIT_S)
            silent_s += WAIT_S

    def _begin(self, time_s: float) -> None:
        """A drive begins; ``time_s`` [s] is now by the robot's clock."""
        self._problem, self._written_mb = "", 0.0
        wall_s = self._wall()
        began = datetime.fromtimestamp(wall_s).astimezone().isoformat(timespec="seconds")
        self._folder.mkdir(parents=True, exist_ok=True)
        self._require_room()
        file = DriveFile(self._free_path(wall_s), {**self._subject.about, "began": began})
        self._log = DriveLog(file, wall_s - time_s, self._subject.models)
        self._flushed_s = time.monotonic()

    def _write(self, heard: Heard) -> None:
        if self._log is None:
            return
        self._log.write(heard)
        if time.monotonic() - self._flushed_s >= FLUSH_S:
            self._written_mb = self._log.file.flush() / MB
            self._require_room()
            self._flushed_s = time.monotonic()

    def _end(self) -> None:
        if self._log is None:
            return
        self._log.file.note(END, {"dropped": str(self.dropped), "phase": self._log.phase})
        self._written_mb = self._log.file.close() / MB
        self._log = None

    def _try(self, step: Callable[..., None], *arguments: Any) -> None:
        """Do a step of the recording; what the disk does not take ends it."""
        try:
            step(*arguments)
        except OSError as error:
            self._problem = "disk full" if error.errno in FULL else (error.strerror or str(error))
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
