"""Recorded drives of people: pictures with the steering angle of each, as stacks split by time.

Three layouts are known by what lies in the folder::

    labels.csv                     columns ``file`` and ``angle`` in [-1, 1]
    data.txt                       Sully Chen: ``<file> <degrees>[,<date>]`` a line, steering wheel
    manifest.json, *.catalog       Donkeycar tub, version 2: ``user/angle`` in [-1, 1]

Angles are positive to the right in all of them, and here.

A trained policy, of whichever task, is asked which way it would steer on their frames.
"""

import csv
import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from enum import IntEnum
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from robot.camera.files import read_picture
from robot.camera.source import fit_to_frame
from robot.errors import ConfigError, ContractError
from robot.inference.policy import REMEDY, OnnxPolicy, open_translator, read_contract
from robot.inference.preprocess import preprocess_batch
from sim_pybullet.tasks.spec import find_task
from sim_pybullet.tasks.track_racing import RACING_ACTIONS

# Donkeycar records the share of full lock. The front wheels of such small cars turn by about 30
# degrees, so the paper's 10 degrees are a third of full lock.
FULL_LOCK_DEG = 30.0
_LEAST_DEG = 3.2  # half a turn in radians: no drive is as straight as that
_MOST_SHARE = 1.5
STRAIGHT_DEG = 10.0  # paper B, section 3.1: steering within (-10, 10) is "going straight"

_Row = tuple[str, Any, str]  # file, angle, where it says so


class Turn(IntEnum):
    """What paper B predicts."""

    LEFT = 0
    STRAIGHT = 1
    RIGHT = 2


@dataclass(frozen=True)
class Drive:
    """A recorded drive, in the order of time."""

    files: tuple[Path, ...]
    steering_deg: np.ndarray  # (N,) positive to the right
    skipped: int = 0  # broken records of a tub


def turns(steering_deg: np.ndarray) -> np.ndarray:
    """(N,) steering angles [deg], positive to the right -> (N,) int64 values of `Turn`."""
    right, left = steering_deg >= STRAIGHT_DEG, steering_deg <= -STRAIGHT_DEG
    return np.where(right, Turn.RIGHT, np.where(left, Turn.LEFT, Turn.STRAIGHT)).astype(np.int64)


def load_drive(folder: Path) -> Drive:
    """A recorded drive, see the module; broken records of a tub are skipped and counted.

    ConfigError for no known layout, a line that cannot be read, or a missing picture.
    """
    readers = {"labels.csv": _labels_csv, "data.txt": _sully_chen, "manifest.json": _tub}
    name = next((name for name in readers if (folder / name).exists()), None)
    if name is None:
        raise ConfigError(f"{folder}: expected one of {', '.join(readers)}, found none of them")
    found = list(readers[name](folder / name))
    rows = [row for row in found if row is not None]
    if not rows:
        raise ConfigError(f"{folder}: expected a recorded drive, got one without a picture")
    angles = np.array([_number(angle, where) for _, angle, where in rows])
    farthest = int(np.abs(angles).argmax())
    most, where = float(abs(angles[farthest])), rows[farthest][2]
    if name == "data.txt":
        if 0.0 < most <= _LEAST_DEG:  # of radians, or of shares
            raise ConfigError(
                f"{where}: expected degrees of the steering wheel, got no angle beyond {most:.3g}; "
                "multiply radians by 57.3, and put shares of full lock into labels.csv"
            )
    elif most > _MOST_SHARE:
        raise ConfigError(
            f"{where}: expected an angle in [-1, 1], got {angles[farthest]}; degrees go in data.txt"
        )
    else:
        angles = FULL_LOCK_DEG * angles
    return Drive(_pictures(folder, [file for file, *_ in rows]), angles, len(found) - len(rows))


def _labels_csv(path: Path) -> Iterator[_Row]:
    with path.open(newline="", encoding="utf-8-sig", errors="replace") as file:
        for line, row in enumerate(csv.DictReader(file), start=2):
            if not row.get("file") or row.get("angle") is None:
                raise ConfigError(f"{path}:{line}: expected the columns file and angle, got {row}")
            yield row["file"], row["angle"], f"{path}:{line}"


def _sully_chen(path: Path) -> Iterator[_Row]:
    for number, line in enumerate(_lines(path), start=1):
        if line.strip():
            name, _, rest = line.strip().partition(" ")
            yield name, rest.split(",")[0], f"{path}:{number}"


def _tub(path: Path) -> Iterator[_Row | None]:
    """None for a record that is broken."""
    for record, where in tub_records(path):
        file, angle = record.get("cam/image_array"), record.get("user/angle")
        known = isinstance(file, str) and angle is not None
        yield (str(file), angle, where) if known else None


def tub_records(manifest: Path) -> Iterator[tuple[dict[str, Any], str]]:
    """A Donkeycar tub's records but the deleted ones, and where each stands; {} for a broken one.

    ConfigError where the manifest, or a catalog that it names, cannot be read.
    """
    folder, tubs = manifest.parent, sorted(manifest.parent.glob("*/manifest.json"))
    if not manifest.exists() and (tubs or any(folder.glob("record_*.json"))):
        told = "one of version 1, which Donkeycar's scripts/convert_to_tub_v2.py converts"
        told = f"a folder of {len(tubs)}; give each alone, as {tubs[0].parent}" if tubs else told
        raise ConfigError(f"{folder}: expected a Donkeycar tub of version 2, got {told}")
    lines = [line for line in _lines(manifest) if line.strip("\0 ")]
    last = (_record(lines[-1]) if lines else None) or {}
    found = (last.get(key) for key in ("deleted_indexes", "paths"))
    deleted, paths = (each if isinstance(each, list) else [] for each in found)
    for name in paths:  # more may lie there: given up, or macOS's ._ files
        catalog = manifest.with_name(Path(str(name)).name)
        for number, line in enumerate(_lines(catalog), start=1):
            record = _record(line) or {}
            if "_index" not in record or record["_index"] not in deleted:
                yield record, f"{catalog}:{number}"


def _lines(path: Path) -> list[str]:
    """Of a text file; what is not UTF-8 becomes a mark that no record holds."""
    try:
        return path.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError as error:
        raise ConfigError(f"{path}: expected a part of the drive, got: {error.strerror}") from error


def _record(text: str) -> dict[str, Any] | None:
    """A line of a tub; None for a broken one: half written, or the NULs of a power cut."""
    try:
        record = json.loads(text)
    except (ValueError, RecursionError):
        return None
    return record if isinstance(record, dict) else None


def _number(text: Any, where: str) -> float:
    try:
        value = float(text)
    except (TypeError, ValueError):
        value = np.nan
    if not np.isfinite(value):
        raise ConfigError(f"{where}: expected an angle, got {text!r}")
    return value


def _pictures(folder: Path, names: list[str]) -> tuple[Path, ...]:
    """Each beside the records, or where the programs put them."""
    files, missing = list[Path](), list[Path]()
    for name in names:
        base = Path(name).name
        places = (folder / name, folder / "images" / base, folder / "data" / base, folder / base)
        found = next((path for path in places if path.is_file()), None)
        (missing if found is None else files).append(found or Path(name))
    if missing:
        told = f"{folder}: expected a picture for each of {len(names)} records, found none for "
        raise ConfigError(f"{told}{len(missing)}, the first {missing[0]}; take these records out")
    return tuple(files)


See = Callable[[np.ndarray], np.ndarray]  # frames (N, 120, 160, 3) -> pictures (N, H, W, 3), uint8
STACK = 4  # paper B: four consecutive frames
TRAINING_SHARE = 0.6
GAP_FRAMES = 20  # between training and test: neighbours look alike


class Stacks(NamedTuple):
    """Some moments of a drive."""

    pictures: np.ndarray  # (M, H, W, 3) uint8 RGB, all pictures of the drive
    last: np.ndarray  # (N,) index of each moment's newest picture
    turns: np.ndarray  # (N,) int64 values of `Turn`: what the person did
    every: int  # of how many pictures one is in the stack

    def stacked(self, chosen: np.ndarray | slice = slice(None)) -> np.ndarray:
        """(N, H, W, 3 * STACK) uint8 of the chosen moments, the oldest picture first."""
        last = self.last[chosen]
        parts = [self.pictures[last - back * self.every] for back in reversed(range(STACK))]
        return np.concatenate(parts, axis=-1)


def frames_of(drive: Drive) -> np.ndarray:
    """(N, 120, 160, 3) uint8 RGB; of pictures that are not 4:3 the middle is taken."""
    return np.stack([fit_to_frame(read_picture(file)) for file in drive.files])


def split_by_time(drive: Drive, frames: np.ndarray, every: int, see: See) -> tuple[Stacks, Stacks]:
    """(training, test): the first 60 % of the drive, and what comes a gap of 20 frames later.

    All moments with a stack's pictures before them. No picture is in both: a random split would
    test on the neighbours of what was trained on. ConfigError if nothing would be left for one.
    """
    end, before = round(TRAINING_SHARE * len(frames)), (STACK - 1) * every
    last = np.arange(before, len(frames))
    training, test = last[last < end], last[last - before >= end + GAP_FRAMES]
    if not len(training) or not len(test):
        raise ConfigError(f"drive: expected enough pictures to train, to test, got {len(frames)}")
    pictures, did = see(frames), turns(drive.steering_deg)
    first, rest = (Stacks(pictures, some, did[some], every) for some in (training, test))
    return first, rest


_AT_ONCE = 256
_OF_WORTH = ("ddqn", "dueling")  # algorithms whose values are no logits


class SteeringPolicy:
    """Stacks of pictures -> turns, with an ONNX policy, seen through a translator if one is named.

    An actor with all-or-nothing wheels steers by how often it turns them: its steering is the mean
    of its actions' by their probabilities. What learned the worth of actions does the best one. A
    policy of one picture is shown the newest; a path it may have leads straight on.

    ContractError for no policy, or one that cannot go left, straight and right; or a translator of
    other pictures.
    """

    def __init__(self, path: Path, translator: str = "") -> None:
        contract = read_contract(path)
        self._policy = OnnxPolicy(path, actions=contract.actions)
        self.image, self.frames = contract.image, contract.frames
        self.translator = translator
        self._translator = (
            open_translator(translator, self.image, "real-to-sim") if translator else None
        )
        actions = np.array(contract.actions)
        drives_a_car = find_task(contract.task).actions == RACING_ACTIONS
        # people's angles are positive to the right, steering of race cars to the left; a robot
        # goes right where its left wheel is the faster
        right = -actions[:, 0] if drives_a_car else actions[:, 0] - actions[:, 1]
        self._steering_deg = FULL_LOCK_DEG * right / np.abs(right).max(initial=1e-9)
        if set(turns(self._steering_deg).tolist()) != set(Turn):
            told = f"{path}: expected a policy that can go left, straight and right, got actions "
            raise ContractError(f"{told}{actions.tolist()}; {REMEDY}")
        if not 1 <= self.frames <= STACK:
            raise ContractError(
                f"{path}: expected at most {STACK} stacked pictures, got {self.frames}"
            )
        self._worth = contract.algorithm in _OF_WORTH

    def see(self, frames: np.ndarray) -> np.ndarray:
        """Frames (N, 120, 160, 3) of reality -> the policy's pictures (N, H, W, 3), uint8."""
        pictures = preprocess_batch(frames, self.image)
        return pictures if self._translator is None else self._translator(pictures)

    def turns(self, stacks: np.ndarray) -> np.ndarray:
        """(N, H, W, 3 * STACK) uint8 -> (N,) int64 values of `Turn`."""
        newest, points = stacks[..., -3 * self.frames :], self._policy.contract.told
        values = []
        for part in np.array_split(newest, -(-len(stacks) // _AT_ONCE)):
            path = np.zeros((len(part), points), np.float32) if points else None
            values.append(self._policy.values(np.ascontiguousarray(part), path))
        found = np.concatenate(values)
        if self._worth:
            return turns(self._steering_deg[found.argmax(1)])
        shares = np.exp(found - found.max(1, keepdims=True))
        return turns(shares @ self._steering_deg / shares.sum(1))


def named_policies(given: Sequence[str]) -> list[tuple[str, int, SteeringPolicy]]:
    """(name, seed, policy) of each ``name=model.onnx`` or ``name=model.onnx+translator.onnx``.

    A name again is another seed. ConfigError without a name, ContractError if it is no policy.
    """
    found: list[tuple[str, int, SteeringPolicy]] = []
    for text in given:
        name, _, path = text.partition("=")
        if not name or not path:
            raise ConfigError(f"--policy: expected name=model.onnx (ours=model.onnx), got {text!r}")
        seed = sum(name == other for other, _, _ in found)
        model, _, translator = path.partition("+")
        found.append((name, seed, SteeringPolicy(Path(model), translator)))
    return found
