"""Donkeycar's tubs, version 2: catalogs of JSON lines beside a folder of pictures.

https://docs.donkeycar.com/guide/train_autopilot; `donkeycar.parts.datastore_v2`, version 5.
An angle of 1 is full right, ours is a hard turn; a throttle of 1 is our speed straight on.
"""

import json
from collections.abc import Iterator, Sequence
from itertools import groupby
from pathlib import Path
from typing import Any

import cv2

from robot.contract import Stick
from robot.errors import ConfigError
from robot.recording.drive_file import picture
from robot.recording.reader import Sample, read_samples
from tools.data.drives import appearing, write_drive
from trainer.experiments.records import tub_records

FIELDS = {
    "cam/image_array": "image_array",
    "user/angle": "float",
    "user/throttle": "float",
    "user/mode": "str",
}
MOST = 1000  # records in a catalog
GAP_S = 1.0  # at most, between two records of a drive
USER, PILOT = "user", "local"  # modes: a person drives, the policy does
JPEG_QUALITY = 95


def to_tub(drives: Sequence[Path], tub: Path) -> int:
    """Write recordings as a tub, a session each; the number of its records."""
    with appearing(tub) as folder:
        (folder / "images").mkdir()
        records: list[dict[str, Any]] = []
        sessions = []
        for number, path in enumerate(drives):
            first = len(records)
            for sample in read_samples(path):
                records.append(_record(folder, len(records), f"{path.stem}_{number}", sample))
            if len(records) == first:
                raise ConfigError(f"{path}: expected a drive with pictures, got none")
            sessions.append(records[-1]["_session_id"])
        created_at = records[0]["_timestamp_ms"] / 1e3
        names = [
            _write_catalog(folder, records, at, created_at) for at in range(0, len(records), MOST)
        ]
        ids = {"all_full_ids": sessions, "last_id": len(drives) - 1, "last_full_id": sessions[-1]}
        counts = {"current_index": len(records), "max_len": MOST, "deleted_indexes": []}
        about = ({"created_at": created_at, "sessions": ids}, {"paths": names, **counts})
        _write_lines(folder / "manifest.json", [list(FIELDS), list(FIELDS.values()), {}, *about])
    return len(records)


def from_tub(tub: Path, out: Path) -> list[Path]:
    """Write a tub's drives as recordings; a session or a pause of a second begins the next one.

    Deleted and broken records, and those whose picture is absent, are left out.
    """
    with appearing(out) as folder:
        names = []
        for number, drive in enumerate(_drives(list(_records(tub)))):
            samples = [_sample(tub, record) for record in drive]
            names.append(write_drive(folder, f"{tub.name}-{number:03d}", "donkeycar", samples).name)
        if not names:
            raise ConfigError(
                f"{tub}: expected a Donkeycar tub of version 2 with pictures, got none"
            )
    return [out / name for name in names]


def _record(folder: Path, index: int, session: str, sample: Sample) -> dict[str, Any]:
    steer, speed = Stick.of(sample.wheels)
    name = f"{index}_cam_image_array_.jpg"
    (folder / "images" / name).write_bytes(_jpeg(sample.picture))
    return {
        "_index": index,
        "_session_id": session,
        "_timestamp_ms": round(1e3 * sample.time_s),
        "cam/image_array": name,
        "user/angle": -steer,
        "user/mode": USER if sample.driver == "person" else PILOT,
        "user/throttle": speed,
    }


def _jpeg(data: bytes) -> bytes:
    """A picture as JPEG; one that is, as it is."""
    if data.startswith(b"\xff\xd8"):
        return data
    quality = [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY]
    return bytes(cv2.imencode(".jpg", picture(data)[..., ::-1], quality)[1])


def _write_catalog(folder: Path, records: list[Any], at: int, created_at: float) -> str:
    name = f"catalog_{at // MOST}.catalog"
    lengths = _write_lines(folder / name, records[at : at + MOST])
    head = {"created_at": created_at, "line_lengths": lengths, "path": f"{name}_manifest"}
    _write_lines(folder / f"{name}_manifest", [{**head, "start_index": at}])
    return name


def _write_lines(path: Path, rows: Sequence[Any]) -> list[int]:
    """JSON, a line each; how long each is, its end counted."""
    lines = [json.dumps(row) + "\n" for row in rows]
    path.write_text("".join(lines), encoding="utf-8")
    return [len(line) for line in lines]


def _records(tub: Path) -> Iterator[dict[str, Any]]:
    for record, _ in tub_records(tub / "manifest.json"):
        image = tub / "images" / Path(str(record.get("cam/image_array"))).name
        time_ms = record.get("_timestamp_ms")
        if isinstance(time_ms, (int, float)) and image.is_file():
            yield {**record, "picture": image, "time_s": time_ms / 1e3}


def _drives(records: Sequence[dict[str, Any]]) -> Iterator[list[dict[str, Any]]]:
    number, before = 0, None
    for record in records:
        if before is not None:
            same = record.get("_session_id") == before.get("_session_id")
            number += not (same and 0.0 <= record["time_s"] - before["time_s"] <= GAP_S)
        record["drive"], before = number, record
    for _, drive in groupby(records, lambda record: record["drive"]):
        yield list(drive)


def _sample(tub: Path, record: dict[str, Any]) -> Sample:
    try:
        driver = "person" if record.get("user/mode", USER) == USER else "policy"
        who = "pilot" if driver == "policy" and "pilot/angle" in record else "user"
        stick = Stick(-float(record[f"{who}/angle"]), float(record[f"{who}/throttle"]))
        return Sample(record["time_s"], record["picture"].read_bytes(), stick.wheels, driver)
    except (OSError, ValueError, LookupError, TypeError) as error:
        raise ConfigError(f"{tub}: record {record.get('_index')}: {error}") from error
