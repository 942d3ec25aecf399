"""``python -m tools.loop.in_step SOCKET TIME NAME MODULE ...``: a program, unchanged, in lock-step.

Runs ``python -m MODULE ...`` in this process with the time that the conductor gives: monotonic
clocks show it, and whoever waits for a while (``sleep``, ``Condition.wait``, an event loop) waits
for the conductor. Everything else, sockets and keys included, is as it always is. Time is replaced
before the program is imported: many modules keep ``time.monotonic`` as they load. Python 3.8.

A message counts as arrived at the moment it was sent: sockets, encryption and threads of ZeroMQ are
real and take real time, in which the conductor's time stands still. Publishers tell what they sent
last; a receiver looks until it has that, even of a publisher that was started anew.
"""

from __future__ import annotations

import itertools
import math
import os
import runpy
import select
import selectors
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any, TextIO, cast

from tools.loop.shared_time import OTHERS, SharedTime, message_number
from tools.loop.stepper import Stepper, Waiter

LONGEST_S, LOOKS = 0.5, 300  # real time for a message; looks besides, which wait as long as it
LOOK_S = 1e-4
PATIENT_MS = 60_000
SEND_QUEUE = 1000  # nothing grows old in it: its thread may be slow, but time waits
_pause = time.sleep  # the real one: this module is imported before time is replaced
_real = time.perf_counter


def replace(of: object, **others: Any) -> None:
    """Put others in the place of what a module or a class has under these names."""
    for name, other in others.items():
        setattr(of, name, other)


def let_sockets_wait() -> None:
    """ZeroMQ's own patience is by real time, which may be long while ours stands still."""
    from robot.link import sockets

    limits = ("HEARTBEAT_TIMEOUT_MS", "CONNECT_TIMEOUT_MS", "HANDSHAKE_MS")
    replace(sockets, SEND_QUEUE=SEND_QUEUE, **dict.fromkeys(limits, PATIENT_MS))


def _look_until(there: Callable[[], bool], shared: SharedTime) -> bool:
    give_up_s, looks = _real() + LONGEST_S, itertools.count()
    while not there():
        if (_real() > give_up_s and next(looks) >= LOOKS) or shared.get("lossy"):
            return False
        _pause(LOOK_S)
    return True


def _watch_streams(shared: SharedTime) -> None:
    from robot.link.sockets import DEAF_S, Publisher, Subscriber

    begin, send, receive = Subscriber.__init__, Publisher.send, Subscriber.receive

    def begin_by_the_wall(subscriber: Any, *arguments: Any, **named: Any) -> None:
        begin(subscriber, *arguments, **named)
        subscriber._clock = _real  # connecting anew takes real time, too
        subscriber.last, subscriber.heard_s = None, shared.get("now")

    def told_send(publisher: Any, message: Any) -> Any:
        sent = send(publisher, message)
        shared.set(sent.KIND, message_number(sent.session, sent.sequence))
        return sent

    def patient_receive(subscriber: Any) -> Any:
        kind, role = subscriber._kind.KIND, subscriber._link.keys.role
        due = shared.get(OTHERS if (kind, role) == ("telemetry", "robot") else kind)
        newest: Any = None

        def there() -> bool:
            nonlocal newest
            if shared.get("now") < subscriber.heard_s + DEAF_S:
                subscriber._alive_s = _real()  # a slow machine is no silence
            if (got := receive(subscriber)) is not None:
                newest, subscriber.heard_s = got, shared.get("now")
                subscriber.last = message_number(got.session, got.sequence)
            return (subscriber.last or due) == due

        if not _look_until(there, shared):
            subscriber.last = due  # lost: do not wait for it again
        return newest

    replace(Subscriber, __init__=begin_by_the_wall, receive=patient_receive)
    replace(Publisher, send=told_send)


def _watch_commands(shared: SharedTime) -> None:
    import zmq

    from robot.link.command_client import CommandClient
    from robot.link.command_server import CommandServer
    from robot.link.messages import Ack, Command

    transmit, send_ack = CommandClient._transmit, Ack.to_bytes

    def counted_transmit(client: Any, command: Any) -> None:
        connected = client._socket.getsockopt(zmq.EVENTS) & zmq.POLLOUT
        transmit(client, command)
        if connected:
            shared.add("command")

    def counted_ack(ack: Any) -> bytes:
        shared.add("ack")
        return send_ack(ack)

    replace(Ack, to_bytes=counted_ack)
    replace(CommandServer, serve=_patient(CommandServer.serve, Command, "command", shared))
    collect = _patient(CommandClient._collect, Ack, "ack", shared)
    replace(CommandClient, _transmit=counted_transmit, _collect=collect)


def _patient(read: Any, kind: Any, slot: str, shared: SharedTime) -> Any:
    """``read`` again until as many messages of this class were heard as were sent."""
    heard, decode = 0.0, kind.from_bytes

    def counted(data: bytes) -> Any:
        nonlocal heard
        heard += 1.0
        return decode(data)

    def patient(owner: Any, argument: Any) -> list[Any]:
        nonlocal heard
        found: list[Any] = []

        def there() -> bool:
            found.extend(read(owner, argument) or ())
            return heard >= shared.get(slot)

        _look_until(there, shared)
        heard = shared.get(slot)  # no longer with strangers' and late ones: the next is waited for
        return found

    replace(kind, from_bytes=staticmethod(counted))
    return patient


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
    let_sockets_wait()
    _watch_streams(shared)
    _watch_commands(shared)
    stepper.start()
    sys.argv = [module, *arguments]
    runpy.run_module(module, run_name="__main__", alter_sys=True)


def replace_time(stepper: Stepper) -> None:
    """Replace clocks and timed waits, and count threads from now on."""
    from robot.computer import clock

    replace(time, monotonic=stepper.now, sleep=stepper.sleep)
    # What threading imported, and what its conditions wait for; locks are made by another name.
    replace(threading, _time=stepper.now, _allocate_lock=lambda: Waiter(stepper))
    sys.modules.update(uvloop=cast(Any, None))  # its timers are not Python's
    _count_threads(stepper)
    replace(clock, Alarm=threading.Event)  # its waits are a condition's; a pipe is not in step
    _replace_select(stepper)
    _replace_hardware_waits(stepper)
    sys.stdin = cast(TextIO, _typed(stepper, sys.stdin))
    from robot.hat import thread

    replace(thread, RLock=Guard)


class Guard:
    """A lock that its thread may take again, and hold while it sleeps: others wait in step."""

    def __init__(self) -> None:
        self._free, self._owner, self._depth = threading.Condition(), 0, 0

    def __enter__(self) -> None:
        with self._free:
            while self._owner not in (0, threading.get_ident()):
                self._free.wait()
            self._owner, self._depth = threading.get_ident(), self._depth + 1

    def __exit__(self, *_: object) -> None:
        with self._free:
            self._depth -= 1
            if not self._depth:
                self._owner = 0
                self._free.notify()


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

    replace(kind, start=counted_start, join=outside_join, _bootstrap_inner=counted_life)


def _replace_select(stepper: Stepper) -> None:
    original = selectors.EpollSelector.select

    def wait(selector: selectors.EpollSelector, timeout: float | None = None) -> list[Any]:
        """As ``select`` of an event loop; what has come is taken before any waiting."""
        events = original(selector, 0)
        if events or (timeout is not None and timeout <= 0.0):
            return events
        waiter = Waiter(stepper, stepper.deadline(timeout))
        readable_fd, fd = os.pipe()
        replace(waiter, open=lambda: os.write(fd, b"\0"))
        poll = select.poll()
        poll.register(readable_fd, select.POLLIN)
        poll.register(selector.fileno(), select.POLLIN)
        try:
            stepper.begin_wait(waiter)
            poll.poll()
        finally:
            stepper.give_up(waiter)
            os.close(readable_fd)
            os.close(fd)
        return original(selector, 0)

    replace(selectors.EpollSelector, select=wait)


def _replace_hardware_waits(stepper: Stepper) -> None:
    """A camera's silence is seen by the age of its newest picture."""
    from robot.camera.source import SocketStream
    from robot.hat import bus

    take = SocketStream._take

    def outside_take(stream: SocketStream) -> Any:
        stream._socket.settimeout(REAL_S)
        with stepper.elsewhere():
            return take(stream)

    replace(SocketStream, _take=outside_take)
    replace(bus, SILENCE_S=REAL_S)


def _replace_decisions(stepper: Stepper, shared: SharedTime) -> None:
    """A decision takes as long as the bench says, for faults, or is none; else it takes no time."""
    from robot.runtime import loop

    values_of = loop.values_of

    def faulty_values(*asked: Any) -> Any:
        decision_s = shared.get("slow")
        if decision_s:
            stepper.sleep(decision_s)
        found = values_of(*asked)
        return found * math.nan if shared.get("nan") and found is not None else found

    replace(loop, values_of=faulty_values)


if __name__ == "__main__":
    main()
