"""A page about a driver in a challenge, with films of its worst episodes."""

from __future__ import annotations

import heapq
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from robot.contract import CONTROL_DT_S
from trainer.judging.challenge import Episode
from trainer.judging.verdict import Verdict
from trainer.mp4 import enlarged, write_mp4
from trainer.report.page import Picture, write_page

WORST = 5  # episodes that are filmed


class Worst:
    """The worst episodes, and what the robots saw at their end."""

    def __init__(self) -> None:
        self._kept: list[tuple[tuple[float, ...], Episode, Sequence[np.ndarray]]] = []

    def add(self, episode: Episode, frames: Sequence[np.ndarray]) -> None:
        """One more; the best of them is forgotten."""
        order = (not episode.success, -episode.tiles, -episode.seed, -episode.robot)
        bad = (order, episode, frames)
        (heapq.heappushpop if len(self._kept) == WORST else heapq.heappush)(self._kept, bad)

    def write(self, out: Path, verdict: Verdict, challenge: str) -> Path:
        """Films, and the page that shows them."""
        out.mkdir(parents=True, exist_ok=True)
        films = []
        for _, episode, frames in sorted(self._kept, key=lambda each: each[0], reverse=True):
            path = out / f"episode_{episode.seed}_{episode.robot}.mp4"
            write_mp4(path, (enlarged(frame) for frame in frames), 1.0 / CONTROL_DT_S)
            title = f"Episode {episode.seed} on {episode.map}: {episode.end.replace('_', ' ')}"
            told = f"{episode.tiles:.1f} tiles, {episode.figures.survival_time:.1f} s; its end."
            films.append(Picture(title, told, path))
        page = out / "judge.html"
        write_page(
            "judge.html",
            page,
            title=f"{verdict.driver}, {challenge}: {len(verdict.episodes)} episodes",
            rows=[
                (n, f"{e.value:.2f}", f"{e.low:.2f} to {e.high:.2f}")
                for n, e in verdict.figures.items()
            ],
            films=films,
        )
        return page
