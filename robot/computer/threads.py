"""Threads beside the control loop: whatever ends one before its time, somebody hears of it."""

import threading
from typing import Optional, TypeVar

from robot.computer.clock import Alarm
from robot.errors import HardwareError

T = TypeVar("T", bound="Worker")


class Worker:
    """A thread in a ``with`` block, or between ``start`` and ``end``. Derive from it.

    What ends it before its time is kept, and ``check`` raises it in the thread that relies on it:
    a robot must not drive on without, say, its watchdog. Its end is waited for ``patience_s`` [s],
    because a device may hang; None for ever.
    """

    def __init__(self, name: str, patience_s: Optional[float] = None) -> None:
        self._ending, self._ended = Alarm(), Alarm()
        self._name, self._patience_s = name, patience_s
        self._thread: Optional[threading.Thread] = None
        self._died: Optional[BaseException] = None

    def __enter__(self: T) -> T:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.end()

    def start(self) -> None:
        """Begin, or begin anew after ``end``."""
        self._ending.clear()
        self._ended.clear()
        self._died = None
        self._thread = threading.Thread(target=self._run, name=self._name, daemon=True)
        self._thread.start()

    def end(self) -> None:
        """Let the work come to its end."""
        self._ending.set()
        self._wake()
        if self._thread is not None and self._ended.wait(self._patience_s):
            self._thread.join()

    def check(self) -> None:
        """Nothing, while all is well; HardwareError when the thread has died, and of what."""
        if self._died is not None:
            told = self._died if isinstance(self._died, HardwareError) else repr(self._died)
            raise HardwareError(f"{self._name} thread: {told}") from self._died

    @property
    def alive(self) -> bool:
        """Whether the thread works."""
        return self._thread is not None and self._thread.is_alive() and self._died is None

    def _work(self) -> None:
        """What the thread does until ``self._ending`` is set."""
        raise NotImplementedError

    def _wake(self) -> None:
        """For work that waits for something else than ``self._ending``."""

    def _run(self) -> None:
        try:
            self._work()
        except BaseException as error:  # noqa: BLE001  kept for the thread that relies on this one
            self._died = error
        finally:
            self._ended.set()


class Silence:
    """Whether a thread that should turn hangs: asked ``looks`` times, and ``limit_s`` long [s].

    Both, because the thread and whoever asks may have been paused together.
    """

    def __init__(self, looks: int, limit_s: float) -> None:
        self._looks, self._limit_s = looks, limit_s
        self._heard, self._heard_s = 0, 0.0
        self._unheard = 0  # looks since then

    def lasts(self, turns: int, now_s: float) -> bool:
        """Whether it does; ``turns`` is what the thread counts up."""
        if turns != self._heard or self._unheard == 0:
            self._heard, self._heard_s, self._unheard = turns, now_s, 0
        self._unheard += 1
        return self._unheard > self._looks and now_s - self._heard_s > self._limit_s
