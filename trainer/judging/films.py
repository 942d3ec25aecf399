"""Films of the episodes that went worst."""

import re
import shutil
from collections.abc import Sequence
from glob import escape
from pathlib import Path
from typing import NamedTuple

from robot.contract import CONTROL_DT_S
from trainer.judging.evaluate import Film
from trainer.mp4 import enlarged, write_mp4

WORST = 5  # episodes that are filmed


class Filmed(NamedTuple):
    """An episode with a film."""

    badness: tuple[float, ...]  # larger is worse, and never the same twice
    title: str
    path: Path


class Worst:
    """The worst of many episodes, each with a title and a film."""

    def __init__(self) -> None:
        self.kept: list[tuple[tuple[float, ...], str, Film]] = []  # by badness, the worst first

    def add(self, badness: tuple[float, ...], title: str, film: Film) -> None:
        """One more, see `Filmed`. The best of them is forgotten."""
        some = [*self.kept, (badness, title, film)]
        self.kept = sorted(some, key=lambda each: each[0], reverse=True)[:WORST]

    def write(self, stem: Path) -> list[Filmed]:
        """Films beside each other, the worst first: ``STEM_1.mp4``, ``STEM_2.mp4``."""
        found = []
        for rank, (badness, title, film) in enumerate(self.kept, start=1):
            path = stem.with_name(f"{stem.name}_{rank}.mp4")
            write_mp4(path, map(enlarged, film), 1.0 / CONTROL_DT_S)
            found.append(Filmed(badness, title, path))
        return found


def keep_films(found: Sequence[Filmed], out: Path, prefix: str) -> list[tuple[str, Path]]:
    """Copy the worst to a folder in place of older ones, ``PREFIX_1_a_title.mp4`` the worst."""
    out.mkdir(parents=True, exist_ok=True)
    for _, old in films(out, prefix):
        old.unlink()
    worst = sorted(found, key=lambda each: each.badness, reverse=True)[:WORST]
    for rank, each in enumerate(worst, start=1):
        words = re.sub(r"[^\w.-]+", "_", each.title)
        shutil.copy(each.path, out / f"{prefix}_{rank}_{words}.mp4")
    return films(out, prefix)


def films(folder: Path, prefix: str) -> list[tuple[str, Path]]:
    """Titles and files of what `keep_films` kept, the worst first."""
    found = sorted(folder.glob(f"{escape(prefix)}_[1-9]_*.mp4"))
    return [(path.stem[len(prefix) + 3 :].replace("_", " "), path) for path in found]


def films_of(evaluation: Path) -> tuple[Path, str]:
    """Folder and prefix of the films of an evaluation, a JSON file: they lie beside it."""
    return evaluation.parent, f"{evaluation.stem}_worst"
