"""Episodes in blocks that processes share; what was cut off goes on with those it has kept.

A block is what one world drives at once, each robot in a place of its own from the clock's start:
elsewhere, or later, the same episode is rounded otherwise. So a block is the same bit for bit,
whoever drives it. A finished one is a file, named after a digest of all that it follows from.
"""

import hashlib
import json
import shutil
import sys
import sysconfig
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from importlib.metadata import distributions
from pathlib import Path
from typing import Any, NamedTuple, Protocol

from rich.console import Console
from rich.progress import MofNCompleteColumn, Progress

from robot.output import write_text
from trainer.judging.films import Filmed, Scene, film_worst
from trainer.processes import shared

ROBOTS = 20  # at once
_CODE = tuple(Path(__file__).parents[2] / name for name in ("robot", "sim_pybullet", "trainer"))
_COLUMNS = (*Progress.get_default_columns(), MofNCompleteColumn())


class Order(Protocol):
    """What is asked of every episode: a frozen dataclass that other processes can be sent."""

    @property
    def files(self) -> Sequence[str]:
        """What is read; names of what is shipped with the code may be among them."""

    def drive(self, seeds: Sequence[int]) -> Iterator[tuple[Any, Scene | None]]:
        """Rows of plain data, the same for the same seeds, in any order; what is to be filmed."""


class Block(NamedTuple):
    """Some episodes of an order, and the file that they are kept in."""

    order: Order
    seeds: Sequence[int]
    file: Path

    def write(self) -> None:
        """Drive them."""
        self.file.parent.mkdir(parents=True, exist_ok=True)
        rows = list[Any]()

        def scenes() -> Iterator[Scene]:
            for row, scene in self.order.drive(self.seeds):
                rows.append(row)
                if scene is not None:
                    yield scene

        worst = film_worst(scenes(), self.file.with_suffix(""))
        films = [(*each[:2], each.path.name) for each in worst]
        write_text(self.file, json.dumps({"rows": sorted(rows), "films": films}))

    def read(self) -> tuple[list[Any], list[Filmed]] | None:
        """The rows and films, once they are there whole."""
        with suppress(OSError, ValueError, KeyError, TypeError):
            told = json.loads(self.file.read_text(encoding="utf-8"))
            films = [Filmed(tuple(b), t, self.file.with_name(name)) for b, t, name in told["films"]]
            return told["rows"], films
        return None

    def done(self) -> bool:
        """Whether they are there."""
        return self.read() is not None


def drive_blocks(
    order: Order,
    title: str,
    seeds: range,
    folder: Path,
    workers: int | None,
    console: Console,
    group: int = 1,
) -> tuple[list[Any], list[Filmed]]:
    """The rows of these episodes, in each of which so many robots share a world, and the films.

    Processes share the blocks that the folder lacks: so many, else one for each core. Who is killed
    is no loss. DuckpilotError as of the order's.
    """
    name, size = digest(order), max(ROBOTS // group, 1)
    parts = [seeds[k : k + size] for k in range(0, len(seeds), size)]
    blocks = [Block(order, p, folder / f"{name}_{p[0]}_{len(p)}.json") for p in parts]
    with Progress(*_COLUMNS, console=console) as bar:
        row = bar.add_task(title, total=group * len(seeds))
        for block in shared(blocks, workers):
            bar.advance(row, group * len(block.seeds))
    rows, films = list[Any](), list[Filmed]()
    for block in blocks:
        whole = block.read()
        assert whole is not None
        rows += whole[0]
        films += whole[1]
    return rows, films


@contextmanager
def kept_beside(path: Path | None, console: Console) -> Iterator[Path]:
    """The folder ``STEM.blocks`` beside a file until it is written; without one, one for now."""
    if path is None or (path.exists() and not path.is_file()):  # a pipe has no place beside it
        with tempfile.TemporaryDirectory() as temporary:
            yield Path(temporary)
        return
    folder = path.resolve().with_name(f"{path.stem}.blocks")
    try:
        yield folder
    except BaseException:
        if any(folder.glob("*.json")):
            console.print(f"{folder} keeps what was driven, the same command goes on", markup=False)
        raise
    shutil.rmtree(folder, ignore_errors=True)


def digest(order: Order) -> str:
    """Of what is asked, the files that it names, this code, and the libraries."""
    installed = distributions(path=[sysconfig.get_path("purelib")])  # Ray adds others to sys.path
    libraries = sorted((each.name, each.version) for each in installed)
    found = hashlib.sha256(repr((order, sys.version, libraries)).encode())
    for path in (*_CODE, *map(Path, order.files)):
        for file in sorted(path.rglob("*")) if path.is_dir() else [path]:
            if file.is_file() and "__pycache__" not in file.parts:
                found.update(hashlib.sha256(file.read_bytes()).digest())
    return found.hexdigest()[:16]
