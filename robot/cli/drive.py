"""Drive. The robot starts DISARMED; a person arms it here or at the monitor."""

import argparse
import logging
import queue
import sys
import threading
from functools import partial
from pathlib import Path
from typing import Callable, Iterable, List, Optional, Tuple

from robot.computer.systemd import Heartbeat, notify_socket, on_ending
from robot.config import RobotConfig
from robot.errors import nearest
from robot.parts import Ask, Tick
from robot.runtime.assemble import open_robot
from robot.runtime.gamepad import Gamepad
from robot.safety.governors import Cap
from robot.safety.state_machine import Command, Verdict
from robot.typed_config import load_yaml

# By hand one drives at the monitor; the empty line is the quickest to type.
WORDS = {
    "": Command.STOP,
    **{command.value: command for command in Command if command is not Command.MANUAL},
}
QUIT = "quit"
_say = partial(print, flush=True)
PROMPT = "type arm, auto, stop (or just Enter), disarm, clear or quit"


class Terminal:
    """An ``Operator`` and a ``Subscriber``; ``lines`` are read in a thread of its own."""

    def __init__(self, lines: Iterable[str], say: Callable[[str], None]) -> None:
        self.quitting = False
        self._say = say
        self._typed: queue.Queue[str] = queue.Queue()
        self._told: Optional[Tuple[Verdict, bool]] = None
        threading.Thread(target=self._read, args=(lines,), name="terminal", daemon=True).start()

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
        """Tell when the state changes, or a rule of the road holds the robot, and why."""
        cap = Cap() if tick.drive is None else tick.drive.cap
        verdict, held = tick.verdict, cap.most_mps == 0.0
        if (verdict, held) != self._told:
            self._told = verdict, held
            self._say(f"{verdict.state.value}: {cap.reason if held else verdict.sentence}")

    def _read(self, lines: Iterable[str]) -> None:
        try:
            for line in lines:
                self._typed.put(line)
        finally:  # nobody can type any more: Ctrl-D, a broken ssh, bytes that are no text
            self._typed.put(Command.STOP.value)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The command's options."""
    parser.add_argument("--config", type=Path, required=True, help="the robot's YAML file")
    parser.add_argument("--gamepad", metavar="DEVICE", help="beside the robot: /dev/input/js0")


def run(options: argparse.Namespace) -> None:
    """Do it, until quit, an interrupt, SIGTERM or SIGHUP."""
    logging.basicConfig(format="%(asctime)s %(levelname)s %(name)s: %(message)s")
    config = load_yaml(RobotConfig, options.config)
    ended: List[bool] = []
    on_ending(lambda *_: ended.append(True))
    getattr(sys.stdin, "reconfigure", dict)(errors="replace")  # else a wrong byte deafens it
    terminal = Terminal(sys.stdin or (), _say)
    notify = notify_socket()
    pads = (Gamepad(options.gamepad),) if options.gamepad else ()
    with open_robot(config, (terminal, *pads), (terminal, Heartbeat(notify))) as runtime:
        _say(PROMPT)
        notify("READY=1")
        runtime.run(ending=lambda: terminal.quitting or bool(ended))
        notify("STOPPING=1")
