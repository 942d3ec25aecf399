"""A page about a driver in a challenge, with films of its worst episodes."""

from __future__ import annotations

from pathlib import Path

from trainer.judging.films import Worst
from trainer.judging.verdict import Verdict
from trainer.report.page import Picture, write_page


def write_worst(out: Path, worst: Worst, verdict: Verdict, challenge: str) -> Path:
    """Films of the worst of a verdict's episodes, and the page that shows them."""
    films = [Picture(name, "Its end.", path) for name, path in worst.write(out, "worst")]
    title = f"{verdict.driver}, {challenge}: {len(verdict.episodes)} episodes"
    rows = [(name, *(f"{x:.2f}" for x in each)) for name, each in verdict.figures.items()]
    write_page("judge.html", out / "judge.html", title=title, rows=rows, films=films)
    return out / "judge.html"
