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

import math
import runpy
import select
import selectors
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any, TextIO, cast

from tools.loop.shared_time import SharedTime, message_number
from tools.loop.stepper import PipeWaiter, Stepper, Waiter

LONGEST_S = 0.25  # real time that one message may take
LOOK_S = 1e-4
PATIENT_MS = 60_000
SEND_QUEUE = 1000  # nothing grows old in it: its thread may be slow, but time waits
_pause = time.sleep  # the real one: this module is imported before time is replaced
_real = time.perf_counter


def install(shared: SharedTime) -> None:
    """Watch the streams and commands of this process."""
    let_sockets_wait()
    _watch_streams(shared)
    _watch_commands(shared)


def let_sockets_wait() -> None:
    """ZeroMQ's own patience is by real time, which may be long while ours stands still."""
    from robot.link import sockets

    limits: Any = sockets
    limits.HEARTBEAT_TIMEOUT_MS = limits.CONNECT_TIMEOUT_MS = PATIENT_MS
    limits.HANDSHAKE_MS = PATIENT_MS
    limits.SEND_QUEUE = SEND_QUEUE


def _look_until(there: Callable[[], bool], shared: SharedTime) -> bool:
    give_up_s = _real() + LONGEST_S
    while not there():
        if _real() > give_up_s or shared.get("lossy"):
            return False
        _pause(LOOK_S)
    return True


def _watch_streams(shared: SharedTime) -> None:
    from robot.link.sockets import Publisher, Subscriber

    publishers: Any = Publisher
    subscribers: Any = Subscriber
    begin, send, receive = subscribers.__init__, publishers.send, subscribers.receive

    def begin_by_the_wall(subscriber: Any, *arguments: Any, **named: Any) -> None:
        begin(subscriber, *arguments, **named)
        subscriber._clock = _real  # connecting anew takes real time, too
        subscriber._alive_s = _real()
        subscriber.last = None

    def told_send(publisher: Any, message: Any) -> Any:
        sent = send(publisher, message)
        shared.set(sent.KIND, message_number(sent.session, sent.sequence))
        return sent

    def patient_receive(subscriber: Any) -> Any:
        due = shared.get(subscriber._kind.KIND)
        newest: Any = None

        def there() -> bool:
            nonlocal newest
            got = receive(subscriber)
            if got is not None:
                newest, subscriber.last = got, message_number(got.session, got.sequence)
            return (subscriber.last or due) == due

        if not _look_until(there, shared):
            subscriber.last = due  # lost: do not wait for it again
        return newest

    subscribers.__init__ = begin_by_the_wall
    publishers.send, subscribers.receive = told_send, patient_receive


def _watch_commands(shared: SharedTime) -> None:
    import zmq

    from robot.link.command_client import CommandClient
    from robot.link.command_server import CommandServer
    from robot.link.messages import Ack, Command

    clients: Any = CommandClient
    servers: Any = CommandServer
    acks: Any = Ack
    transmit, send_ack = clients._transmit, acks.to_bytes

    def counted_transmit(client: Any, command: Any) -> None:
        connected = client._socket.getsockopt(zmq.EVENTS) & zmq.POLLOUT
        transmit(client, command)
        if connected:
            shared.add("command")

    def counted_ack(ack: Any) -> bytes:
        shared.add("ack")
        return bytes(send_ack(ack))

    clients._transmit, acks.to_bytes = counted_transmit, counted_ack
    servers.serve = _patient(servers.serve, Command, "command", shared)
    clients._collect = _patient(clients._collect, Ack, "ack", shared)


def _patient(read: Any, kind: Any, slot: str, shared: SharedTime) -> Any:
    """``read`` again until as many messages of this class were heard as were sent."""
    heard = 0.0
    decode: Any = kind.from_bytes

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

        if not _look_until(there, shared):
            heard = shared.get(slot)
        return found

    kind.from_bytes = staticmethod(counted)
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
    install(shared)
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
