"""The person beside the robot who watches it and answers."""

from __future__ import annotations

import math
from typing import Callable

from robot.errors import ConfigError

YES, NO = ("y", "yes"), ("n", "no")


class Prompts:
    """The person beside the robot, who types; asked again until the answer can be understood.

    ConfigError: from the questions, when the input ends.
    """

    def __init__(
        self, read: Callable[[str], str] = input, show: Callable[..., None] = print
    ) -> None:
        self._read, self._show = read, show

    def tell(self, line: str) -> None:
        """Show a line."""
        self._show(line, flush=True)

    def agrees(self, question: str) -> bool:
        """A question answered with yes or no."""
        while True:
            answer = self._answer(f"{question} [y/n] ").lower()
            if answer in YES + NO:
                return answer in YES
            self.tell("please type y or n; Ctrl-C stops and switches the motors off")

    def number(self, question: str) -> float:
        """A question answered with a number; a decimal comma is understood."""
        while True:
            answer = self._answer(f"{question} ").replace(",", ".")
            try:
                value = float(answer)
            except ValueError:
                value = math.nan
            if math.isfinite(value):
                return value
            self.tell("please type a number, such as -2.5; Ctrl-C stops")

    def _answer(self, prompt: str) -> str:
        try:
            return self._read(prompt).strip()
        except EOFError as error:
            raise ConfigError("expected a person who answers, got the end of the input") from error
