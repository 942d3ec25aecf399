"""Recordings told, drawn and divided; new ones written from what others recorded."""

import shutil
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path
from typing import NamedTuple

import numpy as np

from robot.contract import Stick
from robot.errors import ConfigError
from robot.output import expect_folder
from robot.recording import topics
from robot.recording.drive_file import SUFFIX, DriveFile
from robot.recording.reader import (
    DRIVERS,
    Sample,
    read_about,
    read_pieces,
    read_samples,
    runs,
    take_overs,
)
from robot.recording.topics import Driven, Turn

STATES = {driver: state for state, driver in DRIVERS.items()}
FLUSH_EVERY = 100  # turns


class Told(NamedTuple):
    """One recording in a list."""

    name: str
    robot: str
    seconds: float  # driven, without gaps
    policy: int  # turns
    person: int
    take_overs: int
    good: int  # pieces
    bad: int


def drives_in(places: Sequence[Path]) -> list[Path]:
    """The recordings named, and those in folders named; ConfigError where there is none."""
    found = [p for place in places for p in (sorted(place.glob(f"*{SUFFIX}")) or [place])]
    wrong = next((path for path in found if not path.is_file()), None)
    if wrong is not None:
        raise ConfigError(f"{wrong}: expected a recording ({SUFFIX}), or a folder of them")
    return list(dict.fromkeys(found))


def tell(path: Path) -> Told:
    """What there is to know of a recording."""
    samples = list(read_samples(path))
    by = [sample.driver for sample in samples]
    kinds = [piece.kind for piece in read_pieces(path)]
    seconds = sum(run[-1].time_s - run[0].time_s for run in runs(samples))
    counts = (by.count("policy"), by.count("person"), take_overs(samples))
    marked = (kinds.count("good"), kinds.count("bad"))
    return Told(path.stem, read_about(path).get("robot", ""), seconds, *counts, *marked)


def divide(drives: Sequence[Path], held_out: float, seed: int) -> dict[str, list[str]]:
    """Whole drives to learn from, and ``held_out`` of the driven time to judge by.

    ConfigError with fewer than two drives.
    """
    if len(drives) < 2:
        raise ConfigError(f"split: expected two drives or more, got {len(drives)}")
    seconds = {path: max(tell(path).seconds, 0.1) for path in drives}
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
    for axes, path in zip(rows, drives, strict=True):
        samples = list(read_samples(path))
        began_s = samples[0].time_s if samples else 0.0
        times = np.array([sample.time_s - began_s for sample in samples])
        sticks = np.array([Stick.of(sample.wheels) for sample in samples]).reshape(-1, 2)
        for driver, colour in (("policy", "#2f6fd6"), ("person", "#e07b28")):
            other = np.array([sample.driver != driver for sample in samples], bool)
            for column, style in ((0, "-"), (1, ":")):
                shown = np.where(other, np.nan, sticks[:, column])
                axes.plot(times, shown, style, color=colour, linewidth=1.2)
        for piece in read_pieces(path):
            tint = "#3fb672" if piece.kind == "good" else "#d64545"
            axes.axvspan(piece.from_s - began_s, piece.to_s - began_s, color=tint, alpha=0.2)
        axes.set(title=path.stem, ylim=(-1.3, 1.3), ylabel="left 1, speed 1")
    rows[-1].set_xlabel("s; line: steering, dots: speed; blue: policy, orange: person")
    figure.savefig(str(out))


@contextmanager
def appearing(folder: Path) -> Iterator[Path]:
    """A folder to fill, which gets its name once it is whole; what a kill left is taken away.

    ConfigError where there is something of that name.
    """
    if folder.exists():
        raise ConfigError(f"{folder}: expected a new folder, there is one; choose another name")
    expect_folder(folder.parent)
    hidden = folder.with_name(f".{folder.name}.partial")
    shutil.rmtree(hidden, ignore_errors=True)
    hidden.mkdir(parents=True)
    try:
        yield hidden
        hidden.rename(folder)
    finally:
        shutil.rmtree(hidden, ignore_errors=True)


def write_drive(folder: Path, name: str, robot: str, samples: Iterable[Sample]) -> Path:
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


def _turn(number: int, first: Sample, before: Sample, now: Sample) -> Turn:
    time_s, wheels = now.time_s - first.time_s, (now.wheels.left_mps, now.wheels.right_mps)
    was = (before.wheels.left_mps, before.wheels.right_mps)
    driven = Driven(wheels, was, now.time_s - before.time_s)
    told = (STATES[now.driver], "person", "recorded by another program", wheels)
    return Turn(number, time_s, 0.0, 0.0, *told, number, time_s, driven=driven)


def table(rows: Sequence[Told]) -> str:
    """The list as text."""
    heads = ("drive", "robot", "driven", "policy", "person", "take-overs", "good", "bad")
    cells = [heads] + [(r.name, r.robot, f"{r.seconds:.0f} s", *map(str, r[3:])) for r in rows]
    wide = [max(len(row[i]) for row in cells) for i in range(len(heads))]
    return "\n".join("  ".join(c.ljust(w) for c, w in zip(r, wide, strict=True)) for r in cells)
