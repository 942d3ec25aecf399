"""Films of the episodes that went worst."""

from __future__ import annotations

import re
from glob import escape
from pathlib import Path

from robot.contract import CONTROL_DT_S
from trainer.judging.rides import Film
from trainer.mp4 import enlarged, write_mp4

WORST = 5  # episodes that are filmed


class Worst:
    """The worst of many episodes, each with a title and a film."""

    def __init__(self) -> None:
        self.kept: list[tuple[tuple[float, ...], str, Film]] = []  # by badness, the worst first

    def add(self, badness: tuple[float, ...], title: str, film: Film) -> None:
        """One more; larger is worse, and never the same twice. The best of them is forgotten."""
        some = [*self.kept, (badness, title, film)]
        self.kept = sorted(some, key=lambda each: each[0], reverse=True)[:WORST]

    def write(self, out: Path, prefix: str) -> list[tuple[str, Path]]:
        """Films in a folder in place of older ones, ``PREFIX_1_a_title.mp4`` the worst; `films`."""
        out.mkdir(parents=True, exist_ok=True)
        for _, old in films(out, prefix):
            old.unlink()
        for rank, (_, title, film) in enumerate(self.kept, start=1):
            words = re.sub(r"[^\w.-]+", "_", title)
            write_mp4(out / f"{prefix}_{rank}_{words}.mp4", map(enlarged, film), 1.0 / CONTROL_DT_S)
        return films(out, prefix)


def films(folder: Path, prefix: str) -> list[tuple[str, Path]]:
    """Titles and files of what `Worst.write` wrote, the worst first."""
    found = sorted(folder.glob(f"{escape(prefix)}_[1-9]_*.mp4"))
    return [(path.stem[len(prefix) + 3 :].replace("_", " "), path) for path in found]


def films_of(evaluation: Path) -> tuple[Path, str]:
    """Folder and prefix of the films of an evaluation, a JSON file: they lie beside it."""
    return evaluation.parent, f"{evaluation.stem}_worst"
