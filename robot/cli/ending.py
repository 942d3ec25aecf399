"""What ends a program from outside: systemd's SIGTERM, and SIGHUP when a terminal goes away.

By default either kills a program at once, with the coils on.
"""

from __future__ import annotations

import signal
from typing import Callable


def on_ending(act: Callable[[], None]) -> None:
    """Let ``act`` happen on either; a hang-up that nohup wants ignored stays so."""
    for number in (signal.SIGTERM, signal.SIGHUP):
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, lambda *_: act())


def interrupt() -> None:
    """As Ctrl-C: ``with`` blocks are left in order."""
    raise KeyboardInterrupt
