"""In lock-step, a message counts as arrived at the moment it was sent: receivers wait for it.

Sockets, encryption and threads of ZeroMQ are real and take real time, in which the conductor's time
stands still. Publishers count what they send; a receiver looks until it has got that far. Python
3.8.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from tools.loop.shared_time import SharedTime

LONGEST_S = 0.25  # real time that one message may take
LOOK_S = 1e-4
PATIENT_MS = 60_000
_pause = time.sleep  # the real one: this module is imported before time is replaced
_real = time.perf_counter


def install(shared: SharedTime) -> None:
    """Watch the streams and commands of this process."""
    let_sockets_wait()
    _watch_streams(shared)
    _watch_commands(shared)


def let_sockets_wait() -> None:
    """ZeroMQ's own time-outs are by real time, which may be long while ours stands still."""
    from robot.link import sockets

    limits: Any = sockets
    limits.HEARTBEAT_TIMEOUT_MS = limits.CONNECT_TIMEOUT_MS = PATIENT_MS


def _look_until(there: Callable[[], bool], shared: SharedTime) -> bool:
    give_up_s = _real() + LONGEST_S
    while not there():
        if _real() > give_up_s or shared.get("lossy"):
            return False
        _pause(LOOK_S)
    return True


def _watch_streams(shared: SharedTime) -> None:
    from robot.link.streams import Publisher, Subscriber

    publishers: Any = Publisher
    subscribers: Any = Subscriber
    send, receive = publishers.send, subscribers.receive

    def counted_send(publisher: Any, message: Any) -> Any:
        sent = send(publisher, message)
        shared.set(sent.KIND, sent.sequence)
        return sent

    def patient_receive(subscriber: Any) -> Any:
        due = shared.get(subscriber._kind.KIND)
        got: Any = receive(subscriber)
        newest = got
        last = getattr(subscriber, "last_sequence", None)

        def there() -> bool:
            nonlocal got, newest, last
            if got is not None:
                newest, last = got, got.sequence
            if last is None or last >= due:
                return True
            got = receive(subscriber)
            return False

        if not _look_until(there, shared):
            last = due  # lost: do not wait for it again
        subscriber.last_sequence = last
        return newest

    publishers.send, subscribers.receive = counted_send, patient_receive


def _watch_commands(shared: SharedTime) -> None:
    import zmq

    from robot.link.command_client import CommandClient
    from robot.link.command_server import CommandServer
    from robot.link.commands import Ack, Command

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
