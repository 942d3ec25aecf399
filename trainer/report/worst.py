"""A page about a driver in a challenge, with films of its worst episodes."""

from __future__ import annotations

from pathlib import Path

from trainer.judging.drive_log import Worst, write_film
from trainer.judging.verdict import Verdict
from trainer.report.page import Picture, write_page


def write_worst(out: Path, worst: Worst, verdict: Verdict, challenge: str) -> Path:
    """Films of the worst of a verdict's episodes, and the page that shows them."""
    out.mkdir(parents=True, exist_ok=True)
    films, page = [], out / "judge.html"
    for _, episode, film in worst.kept:
        path = out / f"episode_{episode.seed}_{episode.robot}.mp4"
        write_film(path, film)
        title = f"Episode {episode.seed} on {episode.map}: {episode.end.replace('_', ' ')}"
        told = f"{episode.tiles:.1f} tiles, {episode.figures.survival_time:.1f} s; its end."
        films.append(Picture(title, told, path))
    write_page(
        "judge.html",
        page,
        title=f"{verdict.driver}, {challenge}: {len(verdict.episodes)} episodes",
        rows=[(n, *(f"{x:.2f}" for x in e)) for n, e in verdict.figures.items()],
        films=films,
    )
    return page
