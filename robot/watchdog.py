"""A second thread that looks whether the first one still turns."""

from __future__ import annotations

import threading
from types import TracebackType
from typing import Callable, Optional, Type

PERIOD_S = 0.05  # a hanging loop is noticed so much later than its limit at most


class Watchdog:
    """Calls ``watch`` every ``PERIOD_S`` in a ``with`` block; see ``Runtime.watch``."""

    def __init__(self, watch: Callable[[], None]) -> None:
        self._watch = watch
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, name="watchdog", daemon=True)

    def __enter__(self) -> Watchdog:
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: Optional[Type[BaseException]],
        error: Optional[BaseException],
        trace: Optional[TracebackType],
    ) -> None:
        self._ending.set()
        self._thread.join()

    def _run(self) -> None:
        while not self._ending.wait(PERIOD_S):
            self._watch()
