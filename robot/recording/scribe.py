"""Keeps one recording at a time on the disk, and gives it up when the disk does not take it."""

from __future__ import annotations

import errno
import logging
import shutil
import time
from datetime import datetime
from pathlib import Path
from typing import Callable, Optional

from robot.recording.config import RecordingConfig
from robot.recording.drive_file import END, SUFFIX, UNFINISHED, DriveFile
from robot.recording.drive_log import DriveLog, Heard
from robot.recording.subject import Subject

FLUSH_S = 0.5  # what a power cut can take
MB = 1e6
FULL = (errno.ENOSPC, errno.EDQUOT)

logger = logging.getLogger(__name__)


class Scribe:
    """For one thread. A drive that could not be recorded does not hinder the next.

    Args:
        config: where to, and how much room to leave.
        subject: who drives.
        wall: time of day [s since 1970].
    """

    def __init__(
        self,
        config: RecordingConfig,
        subject: Subject,
        wall: Callable[[], float],
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
        except OSError as error:
            self._give_up(error)
            return
        self._log = DriveLog(file, wall_s - time_s, self._subject.models)
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
        stem = f"{datetime.fromtimestamp(wall_s):%Y%m%d-%H%M%S}-{self._subject.name}"
        for number in range(1000):
            path = self._folder / f"{stem}{f'-{number}' if number else ''}{SUFFIX}"
            if not path.exists() and not path.with_suffix(UNFINISHED).exists():
                return path
        raise FileExistsError(errno.EEXIST, f"a thousand recordings of one second: {stem}")
