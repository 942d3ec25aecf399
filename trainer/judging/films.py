"""Films of the episodes that went worst."""

import re
import shutil
from collections.abc import Iterable, Sequence
from glob import escape
from heapq import nlargest
from pathlib import Path
from typing import NamedTuple

from robot.contract import CONTROL_DT_S
from trainer.judging.evaluate import Film
from trainer.mp4 import enlarged, write_mp4

WORST = 5  # episodes that are filmed

# An episode as it may be filmed: how bad it was, see `Filmed`, its title, what was seen.
Scene = tuple[tuple[float, ...], str, Film]


class Filmed(NamedTuple):
    """An episode with a film."""

    badness: tuple[float, ...]  # larger is worse, and never the same twice
    title: str
    path: Path


def film_worst(scenes: Iterable[Scene], stem: Path) -> list[Filmed]:
    """Films of the worst, which come first: ``STEM_1.mp4``, ``STEM_2.mp4``; no more are held."""
    found = []
    worst = nlargest(WORST, scenes, key=lambda scene: scene[0])
    for rank, (badness, title, film) in enumerate(worst, start=1):
        path = stem.with_name(f"{stem.name}_{rank}.mp4")
        write_mp4(path, map(enlarged, film), 1.0 / CONTROL_DT_S)
        found.append(Filmed(badness, title, path))
    return found


def keep_films(found: Sequence[Filmed], out: Path, prefix: str) -> list[tuple[str, Path]]:
    """Copy the worst to a folder in place of older ones, ``PREFIX_1_a_title.mp4`` the worst."""
    out.mkdir(parents=True, exist_ok=True)
    for _, old in films(out, prefix):
        old.unlink()
    for rank, each in enumerate(nlargest(WORST, found, key=lambda each: each.badness), start=1):
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
