"""Recordings told, drawn and divided; new ones written from what others recorded.

Donkeycar's tubs, version 2, are catalogs of JSON lines beside a folder of pictures
(https://docs.donkeycar.com/guide/train_autopilot; `donkeycar.parts.datastore_v2`, version 5). An
angle of 1 is full right, ours is a hard turn; a throttle of 1 is our speed straight on.
"""

import json
from collections.abc import Iterable, Iterator, Sequence
from datetime import datetime
from itertools import pairwise
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from robot.contract import Stick
from robot.errors import ConfigError, ContractError
from robot.output import atomically
from robot.recording import reader, topics
from robot.recording.drive_file import SUFFIX, DriveFile, picture
from robot.recording.topics import Driven, Turn
from trainer.experiments.records import tub_records
from trainer.run import appearing

STATES = {driver: state for state, driver in reader.DRIVERS.items()}
FLUSH_EVERY = 100  # turns


def drives_in(places: Sequence[Path]) -> list[Path]:
    """The recordings named, and those in folders named."""
    found = [p for place in places for p in (sorted(place.glob(f"*{SUFFIX}")) or [place])]
    if not found:
        raise ConfigError("recordings: expected one or more, or folders of them, got none")
    ours = topics.CAMERA, topics.TURN, topics.TELEMETRY
    for path in found:
        if not (reader.read_about(path) or any(reader.entries(path, *ours))):
            raise ConfigError(f"{path}: expected a recording of a robot's, got another MCAP file")
    return list({path.resolve(): path for path in found}.values())


def tell(path: Path) -> dict[str, Any]:
    """What there is to know of a recording; ``driven`` without gaps [s]."""
    samples = list(reader.read_samples(path))
    by = [sample.driver for sample in samples]
    kinds = [piece.kind for piece in reader.read_pieces(path)]
    return {
        "drive": path.stem,
        "robot": reader.read_about(path).get("robot", ""),
        "driven": sum(run[-1].time_s - run[0].time_s for run in reader.runs(samples)),
        **{driver: by.count(driver) for driver in ("policy", "person")},  # turns
        "take-overs": reader.take_overs(samples),
        **{kind: kinds.count(kind) for kind in reader.KINDS},  # pieces
    }


def divide(drives: Sequence[Path], held_out: float, seed: int) -> dict[str, list[str]]:
    """Whole drives to learn from, ``held_out`` of the time to judge by; ConfigError: under two."""
    if len(drives) < 2:
        raise ConfigError(f"split: expected two drives or more, got {len(drives)}")
    seconds = {path: max(tell(path)["driven"], 0.1) for path in drives}
    order = [drives[i] for i in np.random.default_rng(seed).permutation(len(drives))]
    wanted_s, kept, taken_s = held_out * sum(seconds.values()), order[:1], seconds[order[0]]
    for path in order[1:-1]:
        if abs(taken_s + seconds[path] - wanted_s) < abs(taken_s - wanted_s):
            kept.append(path)
            taken_s += seconds[path]
    learn = [str(path) for path in drives if path not in kept]
    return {"learn": learn, "held_out": [str(path) for path in drives if path in kept]}


def plot(drives: Sequence[Path], out: Path) -> None:
    """Steering and speed over time, a row a drive: the policy's blue, a person's orange."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10.0, 2.2 * len(drives) + 0.5), layout="constrained")
    rows = figure.subplots(len(drives), 1, squeeze=False)[:, 0]
    driven = [list(reader.read_samples(path)) for path in drives]
    if not any(driven):
        raise ConfigError(f"{drives[0]}: expected a drive with pictures, got none")
    for axes, path, samples in zip(rows, drives, driven, strict=True):
        began_s = samples[0].time_s if samples else 0.0
        times = np.array([sample.time_s - began_s for sample in samples])
        sticks = np.array([Stick.of(sample.wheels) for sample in samples]).reshape(-1, 2)
        for driver, colour in (("policy", "#2f6fd6"), ("person", "#e07b28")):
            other = np.array([sample.driver != driver for sample in samples], bool)
            for column, style in ((0, "-"), (1, ":")):
                shown = np.where(other, np.nan, sticks[:, column])
                axes.plot(times, shown, style, color=colour, linewidth=1.2)
        for piece in reader.read_pieces(path):
            tint = "#3fb672" if piece.kind == "good" else "#d64545"
            axes.axvspan(piece.from_s - began_s, piece.to_s - began_s, color=tint, alpha=0.2)
        axes.set(title=path.stem, ylim=(-1.3, 1.3), ylabel="left 1, speed 1")
    rows[-1].set_xlabel("s; line: steering, dots: speed; blue: policy, orange: person")
    with atomically(out) as hidden:
        figure.savefig(str(hidden), format="png")


def write_drive(folder: Path, name: str, robot: str, samples: Iterable[reader.Sample]) -> Path:
    """A recording of what another program recorded; ConfigError for a drive without a turn."""
    samples = iter(samples)
    first = next(samples, None)
    if first is None:
        raise ConfigError(f"{name}: expected a drive with pictures, got none")
    began = datetime.fromtimestamp(first.time_s).astimezone().isoformat(timespec="seconds")
    file = DriveFile(folder / f"{name}{SUFFIX}", {"robot": robot, "map": "", "began": began})
    before, number = first, 0
    for number, sample in enumerate([first, *samples]):
        kind = "png" if sample.picture.startswith(b"\x89PNG") else "jpeg"
        image = topics.image_message(sample.time_s, sample.picture, kind)
        file.add(topics.CAMERA, sample.time_s, image, number)
        file.add(topics.TURN, sample.time_s, _turn(number, first, before, sample).plain(), number)
        before = sample
        if number % FLUSH_EVERY == 0:
            file.flush(sync=False)
    file.close()
    return file.path


def _turn(number: int, first: reader.Sample, before: reader.Sample, now: reader.Sample) -> Turn:
    time_s = now.time_s - first.time_s
    driven = Driven(now.wheels, before.wheels, now.time_s - before.time_s)
    told = (STATES[now.driver], "person", "recorded by another program", now.wheels)
    return Turn(number, time_s, 0.0, 0.0, *told, number, time_s, driven=driven)


def table(rows: Sequence[dict[str, Any]]) -> str:
    """What `tell` told as text."""
    told = [{**row, "driven": f"{row['driven']:.0f} s"} for row in rows]
    cells = [[*row] for row in told[:1]] + [[str(cell) for cell in row.values()] for row in told]
    wide = [max(map(len, column)) for column in zip(*cells, strict=True)]
    return "\n".join("  ".join(c.ljust(w) for c, w in zip(r, wide, strict=True)) for r in cells)


INPUTS = ("cam/image_array", "user/angle", "user/throttle", "user/mode")
TYPES = ("image_array", "float", "float", "str")  # of these
MOST = 1000  # records in a catalog
LEAST_GAP_S, GAP_S = 0.004, 1.0  # between two records of a drive
MOST_SHARE = 1.01  # of full lock and full speed, as floats round
USER, PILOT = "user", "local"  # modes: a person drives, the policy does
JPEG_QUALITY = 95
MOST_S = 1e10


def to_tub(drives: Sequence[Path], tub: Path) -> int:
    """Write recordings as a tub, a session each; the number of its records."""
    with appearing(tub) as folder:
        (folder / "images").mkdir()
        records: list[dict[str, Any]] = []
        sessions = []
        for number, path in enumerate(drives):
            first = len(records)
            for sample in reader.read_samples(path):
                records.append(_record(folder, len(records), f"{path.stem}_{number}", sample))
            if len(records) > first:
                sessions.append(records[-1]["_session_id"])
        if not records:
            raise ConfigError(f"{drives[0]}: expected a drive with pictures, got none")
        created_at = records[0]["_timestamp_ms"] / 1e3
        parts = range(0, len(records), MOST)
        names = [_write_catalog(folder, records, at, created_at) for at in parts]
        ids = {"all_full_ids": sessions, "last_id": len(sessions) - 1, "last_full_id": sessions[-1]}
        counts = {"current_index": len(records), "max_len": MOST, "deleted_indexes": []}
        about = ({"created_at": created_at, "sessions": ids}, {"paths": names, **counts})
        _write_lines(folder / "manifest.json", [INPUTS, TYPES, {}, *about])
    return len(records)


def from_tub(tub: Path, out: Path) -> list[Path]:
    """Write a tub's drives as recordings; a session or a pause of a second begins the next one.

    Deleted and broken records, and those whose picture is absent or none, are left out.
    """
    records = list(_records(tub, broken := list[str]()))
    told = f"left out {len(broken)} records, such as {broken[0]}" if broken else "got none"
    if not records:
        raise ConfigError(f"{tub}: expected a Donkeycar tub of version 2 with pictures, {told}")
    if (most := max(abs(part) for _, s in records for part in Stick.of(s.wheels))) > MOST_SHARE:
        told = f"from -1 to 1, got {most:.3g}; degrees are divided by those of full lock"
        raise ConfigError(f"{tub}: expected angles and throttles {told}")
    gaps = [b.time_s - a.time_s for (one, a), (other, b) in pairwise(records) if one == other]
    if gaps and not LEAST_GAP_S <= (usual_s := float(np.median(gaps))) <= GAP_S:
        told = f"{1e3 * LEAST_GAP_S:g} to {1e3 * GAP_S:g} ms apart, got {1e3 * usual_s:.3g}"
        raise ConfigError(f"{tub}: expected records with _timestamp_ms {told} (median)")
    with appearing(out) as folder:
        drives = enumerate([sample for _, sample in drive] for drive in _drives(records))
        made = [write_drive(folder, f"{tub.name}-{n:03d}", "donkeycar", each) for n, each in drives]
    if broken:
        print(f"{tub}: {told}")
    return [out / path.name for path in made]


def _record(folder: Path, index: int, session: str, sample: reader.Sample) -> dict[str, Any]:
    steer, speed = Stick.of(sample.wheels)
    name = f"{index}_cam_image_array_.jpg"
    (folder / "images" / name).write_bytes(_jpeg(sample))
    return {
        "_index": index,
        "_session_id": session,
        "_timestamp_ms": round(1e3 * sample.time_s),
        "cam/image_array": name,
        "user/angle": -steer,
        "user/mode": USER if sample.driver == "person" else PILOT,
        "user/throttle": speed,
    }


def seen(sample: reader.Sample) -> np.ndarray:
    """The picture of a turn; ContractError: it is none."""
    try:
        return picture(sample.picture)
    except ValueError as error:
        at = f"{datetime.fromtimestamp(sample.time_s):%Y-%m-%d %H:%M:%S}"
        raise ContractError(f"recording: turn of {at}: {error}") from error


def _jpeg(sample: reader.Sample) -> bytes:
    """Its picture as JPEG; one that is, as it is."""
    image, quality = seen(sample), [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY]
    if sample.picture.startswith(b"\xff\xd8"):
        return sample.picture
    return bytes(cv2.imencode(".jpg", image[..., ::-1], quality)[1])


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


def _records(tub: Path, broken: list[str]) -> Iterator[tuple[Any, reader.Sample]]:
    """Each with its session; where broken ones stand, and why they are, is put into a list."""
    for record, where in tub_records(tub / "manifest.json"):
        try:
            yield record.get("_session_id"), _sample(tub, record)
        except (OSError, ValueError, LookupError, TypeError, OverflowError) as error:
            broken.append(f"{where}: {error!r}")


def _drives(records: list[tuple[Any, reader.Sample]]) -> list[list[tuple[Any, reader.Sample]]]:
    begins = [0]
    for number, ((before, last), (session, sample)) in enumerate(pairwise(records), 1):
        if session != before or not 0.0 <= sample.time_s - last.time_s <= GAP_S:
            begins.append(number)
    return [records[a:b] for a, b in pairwise([*begins, len(records)])]


def _sample(tub: Path, record: dict[str, Any]) -> reader.Sample:
    """Of mode ``local_angle`` the pilot steers, and a person gives the throttle."""
    data = (tub / "images" / Path(str(record["cam/image_array"])).name).read_bytes()
    mode, time_s = record.get("user/mode") or USER, float(record["_timestamp_ms"]) / 1e3
    who = "pilot" if mode != USER and "pilot/angle" in record else USER
    gas = USER if mode == "local_angle" else who
    steer, speed = float(record[f"{who}/angle"]), float(record[f"{gas}/throttle"])
    if not (picture(data).size and 0.0 <= time_s < MOST_S and abs(steer) + abs(speed) < 1e4):
        raise ValueError("expected a picture, a time, shares of full lock and of full speed")
    driver = "person" if mode == USER else "policy"
    return reader.Sample(time_s, data, Stick(-steer, speed).wheels, driver)
