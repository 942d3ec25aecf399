"""The person beside the robot: commands typed in, changes of state told."""

from __future__ import annotations

import queue
import threading
from typing import Callable, Iterable, Optional

from robot.errors import nearest
from robot.parts import Ask, Tick
from robot.safety.state_machine import Command, Verdict

# By hand one drives at the monitor; the empty line is the quickest to type.
WORDS = {
    "": Command.STOP,
    **{command.value: command for command in Command if command is not Command.MANUAL},
}
QUIT = "quit"
PROMPT = "type arm, auto, stop (or just Enter), disarm, clear or quit"


class Terminal:
    """An ``Operator`` and a ``Subscriber`` of the runtime.

    Args:
        lines: what is typed; read in a thread of its own, which ends with the program.
        say: prints one line.
    """

    def __init__(self, lines: Iterable[str], say: Callable[[str], None]) -> None:
        self.quitting = False
        self._say = say
        self._typed: queue.Queue[str] = queue.Queue()
        self._told: Optional[Verdict] = None
        thread = threading.Thread(target=self._read, args=(lines,), name="terminal", daemon=True)
        thread.start()

    def serve(self, ask: Ask) -> None:
        """Hand over what was typed."""
        while not self._typed.empty():
            word = self._typed.get().strip().lower()
            if word == QUIT:
                self.quitting = True
            elif word in WORDS:
                answer = ask(WORDS[word], None)
                if answer.sentence:
                    self._say(answer.sentence)
            else:
                self._say(f"unknown {word!r}; {nearest(word, [*filter(None, WORDS), QUIT])}")

    def age_s(self) -> Optional[float]:
        """None: who stands beside the robot sees it."""
        return None

    def on_tick(self, tick: Tick) -> None:
        """Tell when the state changes, and why."""
        if tick.verdict != self._told:
            self._told = tick.verdict
            self._say(f"{tick.verdict.state.value}: {tick.verdict.sentence}")

    def _read(self, lines: Iterable[str]) -> None:
        for line in lines:
            self._typed.put(line)
