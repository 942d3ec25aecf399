"""In lock-step, a message counts as arrived at the moment it was sent: receivers wait for it.

Sockets, encryption and threads of ZeroMQ are real and take real time, in which the conductor's time
stands still. Publishers tell what they sent last; a receiver looks until it has that, even of a
publisher that was started anew. Python 3.8.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from tools.loop.shared_time import SharedTime, session_number

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
        shared.publish(sent.KIND, sent.session, sent.sequence)
        return sent

    def patient_receive(subscriber: Any) -> Any:
        due = shared.published(subscriber._kind.KIND)
        newest: Any = None

        def there() -> bool:
            nonlocal newest
            got = receive(subscriber)
            if got is not None:
                newest, subscriber.last = got, (session_number(got.session), got.sequence)
            session, sequence = subscriber.last or due
            return bool(session == due[0] and sequence >= due[1])

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
