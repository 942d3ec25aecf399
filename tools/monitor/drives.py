"""Past drives: the robot's telemetry from the start of a mission to its end, one file each.

A drive is JSON lines: a header, then one telemetry message per line with ``t_s`` since the start.
A path or attention grid equal to the line before is left out.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import Any, TextIO

from robot.errors import ConfigError, nearest
from robot.link.telemetry import Telemetry
from robot.link.wire import MESSAGE_LIMIT_BYTES, plain

SCHEMA = 1
TAIL_BYTES = 2 * MESSAGE_LIMIT_BYTES
_NAME = re.compile(r"[A-Za-z0-9_.-]{1,80}")


@dataclass(frozen=True)
class DriveHeader:
    """The first line of a drive."""

    robot: str
    map: str
    began: str  # local time, ISO 8601
    destination: tuple[float, float]  # world frame [m]
    schema: int = SCHEMA


@dataclass(frozen=True)
class DriveSummary:
    """One entry of the list of drives."""

    name: str
    began: str
    map: str
    duration_s: float
    phase: str  # how the mission ended


class DriveRecorder:
    """Writes a file per mission; a half-written one is kept when the program ends early."""

    def __init__(self, folder: Path, wall: Callable[[], float]) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        for left in folder.glob("*.jsonl.partial"):
            left.rename(left.with_suffix(""))
        self._folder = folder
        self._wall = wall
        self._file: TextIO | None = None
        self._mission = ""
        self._began_s = 0.0
        self._before: Telemetry | None = None

    def take(self, telemetry: Telemetry) -> bool:
        """Record one report; True when a drive was completed by it."""
        mission = telemetry.mission
        if mission is None:
            return self.close()
        completed = mission.id != self._mission and self.close()
        if mission.phase == "driving" and self._file is None and mission.id != self._mission:
            self._begin(telemetry)
        if self._file is not None:
            self._write(telemetry)
            if mission.phase != "driving":
                return self.close()
        return completed

    def close(self) -> bool:
        """Complete the file of the drive at hand; whether there was one."""
        if self._file is None:
            return False
        path = Path(self._file.name)
        self._file.close()
        self._file = None
        path.rename(path.with_suffix(""))
        return True

    def _begin(self, telemetry: Telemetry) -> None:
        assert telemetry.mission is not None
        began = datetime.fromtimestamp(self._wall())
        self._mission = telemetry.mission.id
        self._began_s = telemetry.t_sent_s
        self._before = None
        name = f"{began:%Y-%m-%dT%H-%M-%S}_{self._mission[:8]}.jsonl.partial"
        header = DriveHeader(
            telemetry.robot,
            telemetry.map,
            began.isoformat(timespec="seconds"),
            telemetry.mission.destination,
        )
        self._file = (self._folder / name).open("w", encoding="utf-8")
        self._file.write(json.dumps(asdict(header)) + "\n")

    def _write(self, telemetry: Telemetry) -> None:
        assert self._file is not None
        thin, before = telemetry, self._before
        if before is not None and before.path == telemetry.path:
            thin = replace(thin, path=())
        if before is not None and before.attention == telemetry.attention:
            thin = replace(thin, attention=None)
        self._before = telemetry
        line = {"t_s": round(telemetry.t_sent_s - self._began_s, 3), **plain(thin)}
        self._file.write(json.dumps(line, separators=(",", ":"), ensure_ascii=False) + "\n")
        self._file.flush()


def list_drives(folder: Path) -> list[DriveSummary]:
    """The complete drives in a folder, newest first; files that are none are left out."""
    summaries = [_summary(path) for path in folder.glob("*.jsonl")]
    found = [summary for summary in summaries if summary is not None]
    return sorted(found, key=lambda drive: (drive.began, drive.name), reverse=True)


def read_drive(folder: Path, name: str) -> list[dict[str, Any]]:
    """Header and reports of a drive, as the page replays them.

    Raises:
        ConfigError: no such drive.
    """
    known = [path.stem for path in folder.glob("*.jsonl")]
    if not _NAME.fullmatch(name) or name not in known:
        raise ConfigError(f"no drive {name!r}; {nearest(name, known)}")
    with (folder / f"{name}.jsonl").open(encoding="utf-8") as file:
        return [line for line in map(_parse, file) if line is not None]


def _summary(path: Path) -> DriveSummary | None:
    first, last = _ends(path)
    if first is None or first.get("schema") != SCHEMA:
        return None
    try:
        mission = (last or {}).get("mission") or {"phase": "stopped"}
        duration_s = float((last or {}).get("t_s", 0.0))
        return DriveSummary(path.stem, first["began"], first["map"], duration_s, mission["phase"])
    except (KeyError, TypeError, ValueError):
        return None


def _ends(path: Path) -> tuple[dict[str, Any] | None, dict[str, Any] | None]:
    """The header and the last whole report, without reading what lies between."""
    with path.open("rb") as file:
        first = _parse(file.readline().decode("utf-8", "replace"))
        file.seek(max(file.tell(), path.stat().st_size - TAIL_BYTES))
        tail = file.read().decode("utf-8", "replace").splitlines()
    reports = (_parse(line) for line in reversed(tail))
    return first, next((report for report in reports if report is not None), None)


def _parse(line: str) -> dict[str, Any] | None:
    """One line; None when it was cut off."""
    try:
        value = json.loads(line)
    except ValueError:
        return None
    return value if isinstance(value, dict) else None
