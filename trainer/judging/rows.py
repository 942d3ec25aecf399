"""Drives kept as they end, so that an evaluation that was cut off goes on where it was.

A file beside the evaluation's own, of JSON lines: first what is asked and of which policy, then one
line for each drive. It is deleted once the evaluation is written.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from robot.errors import ConfigError
from robot.typed_config import to_plain
from sim_pybullet.drive_metrics import DriveMetrics
from trainer.judging.evaluate import Drive, Inputs

_FREE = ("episodes", "seed")  # which episodes are asked for: a drive is the same among others


def rows_beside(evaluation: Path) -> Path:
    """Where the drives of an evaluation, a JSON file, are kept until it is done."""
    return evaluation.with_name(f"{evaluation.stem}.rows.jsonl")


class Rows:
    """The drives of an evaluation so far.

    Args:
        path: of the file; its folder is there.
        inputs: what is asked.
        files: that the answer depends on besides: the policy, and a translator if there is one.

    Raises:
        ConfigError: the file holds drives of something else, or is none of ours.
    """

    def __init__(self, path: Path, inputs: Inputs, files: Sequence[Path]) -> None:
        asked = {k: v for k, v in to_plain(inputs).items() if k not in _FREE}
        prints = [hashlib.sha256(file.read_bytes()).hexdigest()[:16] for file in files]
        head = {"schema": 1, "inputs": asked, "files": prints}
        self.path = path
        self.drives = _read(path, head)
        with path.open("w", encoding="utf-8") as file:  # without a line that was cut off
            file.writelines(_line(each) for each in (head, *map(_row, self.drives.values())))
        self._file = path.open("a", encoding="utf-8")

    def add(self, drive: Drive) -> None:
        """Keep one more, on disk at once."""
        self.drives[drive.seed] = drive
        self._file.write(_line(_row(drive)))
        self._file.flush()

    def close(self, done: bool) -> None:
        """Let go of the file, and delete it when the evaluation is written."""
        self._file.close()
        if done:
            self.path.unlink()


def _read(path: Path, head: dict[str, Any]) -> dict[int, Drive]:
    if not path.exists():
        return {}
    found = []
    for line in path.read_text(encoding="utf-8", errors="replace").splitlines():
        try:
            found.append(json.loads(line))
        except ValueError:
            break  # the last one, cut off
    if not found or found[0] != head:
        raise ConfigError(
            f"{path}: expected the drives of an evaluation that was cut off, of this policy and "
            "with these options, got others; delete the file, or choose another --json"
        )
    drives = [Drive(**{**row, "metrics": DriveMetrics(*row["metrics"])}) for row in found[1:]]
    return {drive.seed: drive for drive in drives}


def _row(drive: Drive) -> dict[str, Any]:
    return drive._asdict()


def _line(value: dict[str, Any]) -> str:
    return json.dumps(value) + "\n"
