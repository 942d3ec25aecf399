"""``python -m tools.loop.in_step SOCKET TIME NAME MODULE ...``: a program, unchanged, in lock-step.

Runs ``python -m MODULE ...`` in this process with the time that the conductor gives: monotonic
clocks show it, and whoever waits for a while (``sleep``, ``Condition.wait``, an event loop) waits
for the conductor. Everything else, sockets and keys included, is as it always is. Time is replaced
before the program is imported: many modules keep ``time.monotonic`` as they load. Python 3.8.
"""

from __future__ import annotations

import math
import runpy
import select
import selectors
import socket
import sys
import threading
import time
from collections.abc import Iterator
from typing import Any, TextIO, cast

from tools.loop import wire_watch
from tools.loop.shared_time import SharedTime
from tools.loop.stepper import PipeWaiter, Stepper, Waiter

REAL_S = 600.0  # that hardware may take to answer, which in the bench's time is none


def main() -> None:
    """Join the conductor, put time in its place, and become the program."""
    path, time_path, name, module, *arguments = sys.argv[1:]
    connection = socket.socket(socket.AF_UNIX)
    connection.connect(path)
    connection.sendall(name.encode().ljust(16))
    shared = SharedTime(time_path, second=name.endswith("2"))
    stepper = Stepper(connection, shared)
    replace_time(stepper)
    _replace_decisions(stepper, shared)
    wire_watch.install(shared)
    stepper.start()
    sys.argv = [module, *arguments]
    runpy.run_module(module, run_name="__main__", alter_sys=True)


def replace_time(stepper: Stepper) -> None:
    """Replace clocks and timed waits, and count threads from now on."""
    clocks: Any = time
    threads: Any = threading
    modules: Any = sys.modules
    clocks.monotonic, clocks.sleep = stepper.now, stepper.sleep
    threads._time = stepper.now  # what threading imported
    modules["uvloop"] = None  # its timers are not Python's
    _count_threads(stepper)
    _replace_condition_wait(stepper)
    _replace_alarms()
    _replace_select(stepper)
    _replace_hardware_waits(stepper)
    sys.stdin = cast(TextIO, _typed(stepper, sys.stdin))


def _typed(stepper: Stepper, lines: TextIO) -> Iterator[str]:
    """What a person types, who is waited for elsewhere."""
    while True:
        with stepper.elsewhere():
            line = lines.readline()
        if not line:
            return
        yield line


def _count_threads(stepper: Stepper) -> None:
    kind: Any = threading.Thread
    start, join, bootstrap = kind.start, kind.join, kind._bootstrap_inner

    def counted_start(thread: threading.Thread) -> None:
        stepper.thread_begins()
        start(thread)

    def counted_life(thread: threading.Thread) -> None:
        try:
            bootstrap(thread)
        finally:
            stepper.thread_ends()

    def outside_join(thread: threading.Thread, timeout: float | None = None) -> None:
        with stepper.elsewhere():
            join(thread, timeout)

    kind.start, kind.join, kind._bootstrap_inner = counted_start, outside_join, counted_life


def _replace_condition_wait(stepper: Stepper) -> None:
    def wait(condition: Any, timeout: float | None = None) -> bool:
        """As `threading.Condition.wait`, which this follows line by line."""
        if not condition._is_owned():
            raise RuntimeError("cannot wait on un-acquired lock")
        waiter = Waiter(stepper, stepper.deadline(timeout))
        condition._waiters.append(waiter)
        saved = condition._release_save()
        released = False
        try:
            released = waiter.block()
            return released
        finally:
            condition._acquire_restore(saved)
            if not released and waiter in condition._waiters:
                condition._waiters.remove(waiter)

    conditions: Any = threading.Condition
    conditions.wait = wait


def _replace_alarms() -> None:
    """An alarm's wait is one of a condition, as above; its pipe would not be in step."""
    from robot.computer.clock import Alarm

    def begin(alarm: Any) -> None:
        event = threading.Event()
        for name in ("is_set", "set", "clear", "wait"):
            setattr(alarm, name, getattr(event, name))

    alarms: Any = Alarm
    alarms.__init__ = begin


def _replace_select(stepper: Stepper) -> None:
    original = selectors.EpollSelector.select

    def wait(selector: selectors.EpollSelector, timeout: float | None = None) -> list[Any]:
        """As ``select`` of an event loop; what has come is taken before any waiting."""
        events = original(selector, 0)
        if events or (timeout is not None and timeout <= 0.0):
            return events
        waiter = PipeWaiter(stepper, stepper.deadline(timeout))
        poll = select.poll()
        poll.register(waiter.fd, select.POLLIN)
        poll.register(selector.fileno(), select.POLLIN)
        try:
            stepper.begin_wait(waiter)
            poll.poll()
        finally:
            stepper.give_up(waiter)
            waiter.close()
        return original(selector, 0)

    selector_kind: Any = selectors.EpollSelector
    selector_kind.select = wait


def _replace_hardware_waits(stepper: Stepper) -> None:
    """A camera's silence is seen by the age of its newest picture."""
    from robot.camera.source import SocketStream
    from robot.hat import bus

    buses: Any = bus
    streams: Any = SocketStream
    buses.SILENCE_S = REAL_S
    take = streams._take

    def outside_take(stream: SocketStream) -> Any:
        stream._socket.settimeout(REAL_S)
        with stepper.elsewhere():
            return take(stream)

    streams._take = outside_take


def _replace_decisions(stepper: Stepper, shared: SharedTime) -> None:
    """A decision takes as long as the bench says, for faults, or is none; else it takes no time."""
    from robot.runtime import loop

    loops: Any = loop
    values_of = loops.values_of

    def faulty_values(*asked: Any) -> Any:
        decision_s = shared.get("slow")
        if decision_s:
            stepper.sleep(decision_s)
        found = values_of(*asked)
        return found * math.nan if shared.get("nan") and found is not None else found

    loops.values_of = faulty_values


if __name__ == "__main__":
    main()
