"""Blocks of episodes come out the same, whoever drives them and however often that was cut off."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from robot.errors import ConfigError
from trainer.judging import blocks
from trainer.judging.blocks import digest, drive_blocks, kept_beside
from trainer.judging.films import Scene

SEEDS = range(10, 15)
BLOCKS = ([10, 11], [12, 13], [14])


@dataclass(frozen=True)
class Toy:
    """Drives numbers, and notes in a folder which and who; may come to grief at seed 14."""

    notes: Path
    grief: str = ""
    films: bool = False

    @property
    def files(self) -> list[str]:
        return ["loop", str(self.notes / "model")]

    def drive(self, seeds: Sequence[int]) -> Iterator[tuple[Any, Scene | None]]:
        with (self.notes / f"{seeds[0]}").open("a") as file:
            file.write(f"{os.getpid()}\n")
        if seeds[0] == 14:
            self._come_to_grief()
        for seed in reversed(seeds):
            scene = (seed % 10,), f"{seed}", [np.full((8, 8, 3), seed, np.uint8)]
            yield (seed, 1.0 / seed, float("nan"), True, None), scene if self.films else None

    def _come_to_grief(self) -> None:
        if self.grief == "refused":
            raise ConfigError("expected 15, got 14")
        if self.grief == "killed" and len(driven(self.notes)[14]) == 1:
            os.kill(os.getpid(), signal.SIGKILL)
        while self.grief == "stuck" and not (self.notes / "go").exists():
            time.sleep(0.01)


def driven(notes: Path) -> dict[int, list[int]]:
    """The processes that drove each block."""
    found = {int(each.name): each.read_text() for each in notes.iterdir() if each.name.isdigit()}
    return {seed: list(map(int, pids.split())) for seed, pids in found.items() if pids}


def drive(toy: Toy, workers: int, beside: Path | None) -> str:
    console = Console(quiet=True)
    with kept_beside(beside, console) as folder:
        return repr(drive_blocks(toy, "toy", SEEDS, folder, workers, console)[0])


@pytest.fixture(autouse=True)
def small_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(blocks, "ROBOTS", 2)


@pytest.fixture
def notes(tmp_path: Path) -> Path:
    (tmp_path / "notes").mkdir()
    (tmp_path / "notes" / "model").write_bytes(b"policy")
    return tmp_path / "notes"


def test_rows_come_in_order_from_any_number_of_processes(tmp_path: Path, notes: Path) -> None:
    beside = tmp_path / "out" / "e.json"
    alone = drive(Toy(notes), 1, beside)
    assert alone == repr([[seed, 1.0 / seed, float("nan"), True, None] for seed in SEEDS])
    assert {pid for pids in driven(notes).values() for pid in pids} == {os.getpid()}
    assert drive(Toy(notes), 3, beside) == drive(Toy(notes), 2, None) == alone
    assert [len(pids) for _, pids in sorted(driven(notes).items())] == [3] * len(BLOCKS)
    assert len({pid for pids in driven(notes).values() for pid in pids}) == 1 + 2 * len(BLOCKS)
    assert not (tmp_path / "out" / "e.blocks").exists()


def test_who_is_killed_loses_nothing(tmp_path: Path, notes: Path) -> None:
    assert drive(Toy(notes, "killed"), 2, tmp_path / "e") == drive(Toy(notes), 1, tmp_path / "e")


def test_what_cannot_be_driven_is_told_by_who_asked(tmp_path: Path, notes: Path) -> None:
    for workers in (1, 2):
        with pytest.raises(ConfigError, match="expected 15, got 14"):
            drive(Toy(notes, "refused"), workers, tmp_path / "e.json")
    assert len(driven(notes)[10]) == 1, "kept"


def test_after_a_kill_it_goes_on_and_nobody_is_left(tmp_path: Path, notes: Path) -> None:
    """The whole program is killed while a block is being driven."""
    program = (
        "import sys; from pathlib import Path; from tests.trainer.judging import test_blocks as t\n"
        "t.blocks.ROBOTS = 2; notes, beside = map(Path, sys.argv[1:])\n"
        "if __name__ == '__main__': t.drive(t.Toy(notes, 'stuck'), 2, beside)"
    )
    beside, script = tmp_path / "e.json", tmp_path / "program.py"
    script.write_text(program)
    process = subprocess.Popen([sys.executable, str(script), str(notes), str(beside)])
    kept = tmp_path / "e.blocks"
    until(lambda: len(list(kept.glob("*.json"))) == len(BLOCKS) - 1 and 14 in driven(notes))
    process.kill()
    process.wait()
    (stuck,) = driven(notes)[14]
    until(lambda: not alive(stuck))
    whole = sorted(kept.glob("*.json"))[0]
    whole.write_bytes(whole.read_bytes()[:-9])  # a disk that lost its end
    (notes / "go").touch()
    assert drive(Toy(notes, "stuck"), 2, beside) == drive(Toy(notes, "stuck"), 1, None)
    twice = sorted(seed for seed, pids in driven(notes).items() if len(pids) == 3)
    assert twice == [10, 14], "each once, then once without a place to keep them, but these"


def until(holds: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 300.0
    while not holds():
        assert time.monotonic() < deadline
        time.sleep(0.02)


def alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except FileNotFoundError:
        return False


def test_blocks_of_something_else_are_not_believed(
    notes: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    code = tmp_path / "code"
    (code / "maps").mkdir(parents=True)
    (code / "a.py").write_text("speed = 1")
    monkeypatch.setattr(blocks, "_CODE", (code,))
    toy = Toy(notes)
    found = [digest(toy), digest(replace(toy, grief="other"))]
    (notes / "model").write_bytes(b"another policy")
    found.append(digest(toy))
    (code / "a.py").write_text("speed = 2")
    found.append(digest(toy))
    (code / "maps" / "loop.yaml").write_text("tiles: []")
    found.append(digest(toy))
    (tmp_path / "ray-2.0.dist-info").mkdir()
    (tmp_path / "ray-2.0.dist-info" / "METADATA").write_text("Name: ray\nVersion: 2.0\n")
    monkeypatch.syspath_prepend(tmp_path)  # as Ray does with its own
    assert digest(toy) == found[-1]
    monkeypatch.setattr(blocks, "distributions", lambda path: [])
    found.append(digest(toy))
    assert len(set(found)) == len(found)
    (code / "__pycache__").mkdir()
    (code / "__pycache__" / "a.pyc").write_bytes(b"compiled")
    assert digest(toy) == found[-1]


def test_films_are_kept_with_their_blocks(notes: Path, tmp_path: Path) -> None:
    asked = Toy(notes, films=True), "toy", SEEDS, tmp_path, 1, Console(quiet=True)
    films = sorted(drive_blocks(*asked)[1], reverse=True)
    assert [film.title for film in films[:3]] == ["14", "13", "12"]
    assert len({film.path.read_bytes() for film in films}) > 1
    assert sorted(drive_blocks(*asked)[1], reverse=True) == films
    assert len(driven(notes)[10]) == 1
