"""How far an evaluation is: a bar where a person looks, lines where the output is a file."""

from __future__ import annotations

import time
from collections.abc import Callable

from rich.console import Console
from rich.progress import MofNCompleteColumn, Progress

EVERY_S = 30.0  # between two lines


class Told:
    """Counts drives aloud; use it as a context.

    Args:
        console: where.
        title: what is driven.
        total: how many drives are asked for.
        done: how many of them were kept from before.
        clock: [s].
    """

    def __init__(
        self,
        console: Console,
        title: str,
        total: int,
        done: int = 0,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._console, self._title, self._total, self._clock = console, title, total, clock
        self._first = self._done = done
        self._good = 0
        self._began = self._spoke = clock()
        columns = (*Progress.get_default_columns(), MofNCompleteColumn())
        self._bar = Progress(*columns, console=console, disable=not console.is_terminal)
        self._row = self._bar.add_task(title, total=total, completed=done)

    def __enter__(self) -> Told:
        self._bar.start()
        if self._first:
            self._console.print(f"{self._title}: goes on after {self._first} drives", markup=False)
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.stop()

    def add(self, success: bool) -> None:
        """One more drive has ended."""
        self._done += 1
        self._good += success
        self._bar.advance(self._row)
        now = self._clock()
        if not self._console.is_terminal and now - self._spoke >= EVERY_S:
            self._spoke = now
            rate = (self._done - self._first) / (now - self._began)
            self._console.print(
                f"{self._title}: {self._done} of {self._total}, {self._good} of the last "
                f"{self._done - self._first} succeeded, {rate:.2f} a second, "
                f"{(self._total - self._done) / rate:.0f} s to go",
                markup=False,
            )
