"""Past drives: recorded by the monitor from their start to their end, and read again.

A drive, by the policy or by hand, is an MCAP file with the robot's reports and pictures as they
came here. The robot's own recordings, copied into the folder, are listed, played and marked alike.
"""

import json
import struct
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

from mcap.exceptions import McapError
from mcap.reader import SeekingReader

from robot.errors import ConfigError, expect_one_of
from robot.link.messages import FrameMessage, Telemetry
from robot.link.wire import plain
from robot.recording import topics
from robot.recording.drive_file import ABOUT, END, SUFFIX, DriveFile
from robot.recording.reader import Piece, entries, mark, read_pieces, recover_folder

FLUSH_S = 0.5
DAMAGES = (OSError, McapError, ValueError, LookupError, TypeError, RecursionError, struct.error)
PICTURE_AGE_S = 2.0  # an older one is not what the robot saw then
_MARKING = threading.Lock()  # a recording is written anew for it


@dataclass(frozen=True)
class DriveSummary:
    """One entry of the list of drives."""

    name: str
    began: str  # local time, ISO 8601
    map: str
    duration_s: float
    phase: str  # how the mission ended


class DriveRecorder:
    """Writes a file per drive; one that was cut off is made whole at the next start.

    OSError: from every method, when the disk does not take it.
    """

    def __init__(self, folder: Path, wall: Callable[[], float]) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        list(recover_folder(folder))
        self._folder = folder
        self._wall = wall
        self._file: DriveFile | None = None
        self._mission = self._phase = ""
        self._offset_s = 0.0  # from the robot's clock to the time since 1970
        self._flushed_s = 0.0

    def take(self, telemetry: Telemetry) -> bool:
        """Record one report; True when a drive was completed by it.

        Whoever takes over from the policy, and hands over again, is in one drive.
        """
        mission = telemetry.mission
        driving = mission.id if mission is not None and mission.phase == "driving" else ""
        by_hand = telemetry.state == "MANUAL"
        ends = telemetry.t_sent_s < self._flushed_s  # the robot, and its clock, began anew
        ends |= driving != "" and self._mission not in ("", driving)
        completed = ends and self.close()
        if (driving or by_hand) and self._file is None:
            self._begin(telemetry, driving or "hand")
        if self._file is not None:
            if mission is not None and (driving or self._mission):
                self._phase = mission.phase
            if by_hand:
                self._phase = "by hand"
            time_s = telemetry.t_sent_s + self._offset_s
            self._file.add(topics.TELEMETRY, time_s, plain(telemetry), telemetry.sequence)
            if telemetry.t_sent_s - self._flushed_s >= FLUSH_S:
                self._flushed_s = telemetry.t_sent_s
                self._file.flush(sync=False)  # a slow disk must not hold up a STOP
            if not driving and not by_hand:
                completed = self.close()
        self._mission = driving
        return completed

    def take_frame(self, frame: FrameMessage) -> None:
        """Record a picture, during a drive."""
        if self._file is not None:
            time_s = frame.t_capture_s + self._offset_s
            message = topics.image_message(time_s, frame.jpeg, "jpeg")
            self._file.add(topics.CAMERA, time_s, message, frame.sequence)

    def close(self) -> bool:
        """Complete the file of the drive at hand; whether there was one."""
        file, self._file = self._file, None
        if file is None:
            return False
        file.note(END, {"phase": self._phase if self._phase != "driving" else "stopped"})
        file.close()
        return True

    def _begin(self, telemetry: Telemetry, mission: str) -> None:
        wall_s = self._wall()
        self._offset_s = wall_s - telemetry.t_sent_s
        self._flushed_s = telemetry.t_sent_s
        at = datetime.fromtimestamp(wall_s)
        about = {
            "robot": telemetry.robot,
            "map": telemetry.map,
            "began": at.isoformat(timespec="seconds"),
            "model": telemetry.model,
        }
        self._file = DriveFile(self._folder / f"{at:%Y%m%d-%H%M%S-%f}-{mission[:8]}{SUFFIX}", about)


def list_drives(folder: Path) -> list[DriveSummary]:
    """The complete drives in a folder, newest first; files that are none are left out."""
    found = []
    for path in folder.glob(f"*{SUFFIX}"):
        with suppress(ConfigError):
            found.append(_summary(path))
    return sorted(found, key=lambda drive: (drive.began, drive.name), reverse=True)


def read_drive(folder: Path, name: str) -> list[dict[str, Any]]:
    """The robot's reports, each with ``t_s`` since the first; a path equal to the last is left out.

    ConfigError: no such drive.
    """
    reports: list[dict[str, Any]] = []
    path: Any = None
    file, began_s = _began(folder, name)
    with _opened(file) as reader:
        for _, _, message in reader.iter_messages([topics.TELEMETRY.name], log_time_order=False):
            report = json.loads(message.data)
            report["t_s"] = round(message.log_time / topics.NS - began_s, 3)
            path, report["path"] = report["path"], [] if report["path"] == path else report["path"]
            reports.append(report)
    return reports


def read_picture(folder: Path, name: str, t_s: float) -> tuple[bytes, str] | None:
    """The picture that was the newest ``t_s`` [s] into the drive, and its media type, if any.

    ConfigError: no such drive.
    """
    path, began_s = _began(folder, name)
    at = topics.to_ns(began_s + t_s)
    with _opened(path) as reader:
        pictures = reader.iter_messages(
            [topics.CAMERA.name],
            starting_at=max(0, at - topics.to_ns(PICTURE_AGE_S)),
            ending_at=at,
            reverse=True,
        )
        for _, _, message in pictures:
            image = json.loads(message.data)
            return topics.image_bytes(image), f"image/{image['format']}"
    return None


def read_marks(folder: Path, name: str) -> list[Piece]:
    """What is marked in a drive, in seconds since its first report; ConfigError: no such drive."""
    path, began_s = _began(folder, name)
    return [Piece(p.from_s - began_s, p.to_s - began_s, p.kind) for p in read_pieces(path)]


def write_marks(folder: Path, name: str, pieces: Sequence[Piece]) -> None:
    """Mark these pieces and no others; as ``read_marks``, and ConfigError for wrong ones."""
    with _MARKING:
        path, began_s = _began(folder, name)
        mark(path, [Piece(p.from_s + began_s, p.to_s + began_s, p.kind) for p in pieces])


def _began(folder: Path, name: str) -> tuple[Path, float]:
    expect_one_of("drive", name, [path.name[: -len(SUFFIX)] for path in folder.glob(f"*{SUFFIX}")])
    path = folder / f"{name}{SUFFIX}"
    first = next(entries(path, topics.TELEMETRY), None)
    return path, 0.0 if first is None else first.time_s


@contextmanager
def _opened(path: Path) -> Iterator[SeekingReader]:
    try:
        with path.open("rb") as stream:
            yield SeekingReader(stream)
    except DAMAGES as error:
        raise ConfigError(f"{path.name}: a damaged drive: {error}") from error


def _summary(path: Path) -> DriveSummary:
    with _opened(path) as reader:
        facts = {record.name: record.metadata for record in reader.iter_metadata()}
        summary = reader.get_summary()
        if summary is None or summary.statistics is None:
            raise ValueError("no summary")
        about, statistics = facts[ABOUT], summary.statistics
    duration_s = (statistics.message_end_time - statistics.message_start_time) / topics.NS
    phase, name = facts.get(END, {}).get("phase", "stopped"), path.name[: -len(SUFFIX)]
    return DriveSummary(name, about.get("began", ""), about.get("map", ""), duration_s, phase)
