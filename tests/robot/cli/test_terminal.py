from __future__ import annotations

import threading
from dataclasses import replace
from typing import Iterable, Iterator, List

import pytest

from robot.cli.drive import Terminal
from robot.contract import CONTROL_DT_S
from robot.geometry import STILL
from robot.safety.governors import Cap
from robot.safety.state_machine import Command, State
from robot.safety.wheel_limits import Drive
from tests.robot.camera.test_newest import eventually
from tests.robot.runtime.test_loop import Bench
from tests.robot.runtime.test_rules import at_line


def typed(*lines: str) -> "tuple[Terminal, List[str]]":
    said: List[str] = []
    terminal = Terminal([f"{line}\n" for line in lines], said.append)
    eventually(lambda: terminal._typed.qsize() == len(lines) + 1)
    assert terminal._typed.queue.pop() == "stop"  # of who hung up; here somebody stays
    return terminal, said


def test_words_become_commands_and_refusals_are_told() -> None:
    bench = Bench()
    bench.turn()
    terminal, said = typed("auto", "ARM", " auto ", "", "clear")
    terminal.serve(bench.runtime.ask)
    assert bench.state is State.HOLD, "Enter alone stops"
    assert said == [
        "auto is not possible in DISARMED; possible: arm",
        "clear is not possible in HOLD; possible: arm, disarm",
    ]


def broken() -> Iterator[str]:
    yield "what\n"
    raise UnicodeDecodeError("utf-8", b"\xff", 0, 1, "invalid start byte")


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
@pytest.mark.parametrize(("lines", "count"), [((), 1), (broken(), 2)])
def test_who_can_type_no_more_stops_the_robot(lines: Iterable[str], count: int) -> None:
    """Ctrl-D and a broken ssh end the input, and bytes that are no text the thread that reads."""
    bench = Bench().drive()
    assert bench.state is State.AUTO
    terminal = Terminal(lines, lambda _: None)
    eventually(lambda: terminal._typed.qsize() == count)
    eventually(lambda: all(thread.name != "terminal" for thread in threading.enumerate()))
    terminal.serve(bench.runtime.ask)
    assert bench.state is State.HOLD


def test_a_line_that_never_comes_keeps_no_program_from_ending() -> None:
    typing, before = threading.Event(), set(threading.enumerate())
    Terminal(iter(typing.wait, True), lambda _: None)  # type: ignore[arg-type]
    (thread,) = set(threading.enumerate()) - before
    assert thread.daemon
    typing.set()
    thread.join(5.0)


def test_an_unknown_word_is_told_with_the_nearest() -> None:
    terminal, said = typed("amr", "manual")
    terminal.serve(Bench().runtime.ask)
    assert "unknown 'amr'; did you mean 'arm'?" in said[0]
    assert "unknown 'manual'" in said[1]


def test_quit_ends_the_program_not_the_safety() -> None:
    bench = Bench().drive()
    terminal, _ = typed("quit")
    assert not terminal.quitting
    terminal.serve(bench.runtime.ask)
    assert terminal.quitting
    bench.runtime.run(ending=lambda: terminal.quitting)
    assert bench.state is State.DISARMED


def test_what_a_rule_holds_the_robot_for_is_told_once_and_when_it_goes_on() -> None:
    bench = at_line(0.05)
    terminal, said = typed()
    for _ in range(20):
        terminal.on_tick(bench.runtime.step())
        bench.clock.now_s += CONTROL_DT_S
    drives = "AUTO: auto, by a person"
    assert said == [drives, "AUTO: it stands at a stop line", drives]


def test_a_rule_that_only_slows_the_robot_holds_it_not() -> None:
    bench = Bench().drive()
    terminal, said = typed()
    tick = bench.runtime.step()
    for most_mps in (0.05, 0.0):
        drive = Drive(STILL, STILL, CONTROL_DT_S, Cap(most_mps, "somebody is ahead"))
        terminal.on_tick(replace(tick, drive=drive))
    assert said == ["AUTO: auto, by a person", "AUTO: somebody is ahead"]


def test_changes_of_state_are_told_once() -> None:
    bench = Bench()
    terminal, said = typed()
    assert terminal.age_s() is None
    for command in (None, None, Command.ARM, None, Command.AUTO, None, None):
        if command:
            bench.runtime.ask(command)
        terminal.on_tick(bench.runtime.step())
    assert [line.split(":")[0] for line in said] == ["DISARMED", "READY", "AUTO"]
