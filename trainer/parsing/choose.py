"""How much of the loss's favour for rare classes a parser takes back: chosen on training frames.

Frames that are held out, and those that a later test asks about, must have no part in a choice.
So the training frames are divided once more: a parser learns from the first three quarters of
every sequence and is asked about the rest.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console

from trainer.parsing.labelled import Labelled, split_by_sequence
from trainer.parsing.scores import ParsingScore
from trainer.parsing.train import ParseConfig, Parser, evaluate, teach

SHARES = (0.0, 0.25, 0.5, 0.75, 1.0)


@dataclass(frozen=True)
class Choice:
    """What each share gives on the frames that were put aside; the best by mean IoU."""

    best: float
    scores: tuple[tuple[float, ParsingScore], ...]


def choose_undone(
    config: ParseConfig, sources: Sequence[Labelled], checkpoint: Path, console: Console
) -> Choice:
    """Teach a parser on part of the training frames and find the best share on the others.

    Args:
        config: how it is taught.
        sources: training frames only; the last source is the one that the share is chosen for.
        checkpoint: of the teaching, as of `trainer.parsing.train.teach`.
        console: where progress is shown.
    """
    halves = [split_by_sequence(source) for source in sources]
    parser = teach(config, [learned for learned, _ in halves], checkpoint, console)
    asked = halves[-1][1]
    scores = []
    for share in SHARES:
        taken_back = Parser(config, parser.network, parser.weights, share)
        scores.append((share, evaluate(taken_back, asked, "training")))
    best = max(scores, key=lambda row: row[1].mean_iou)[0]
    return Choice(best, tuple(scores))
