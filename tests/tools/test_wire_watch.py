"""In lock-step nobody reads past a message that was sent, whoever sent it."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import pytest

from robot.link import sockets
from robot.link.messages import PosesMessage, Sighting
from robot.link.sockets import Link, LinkConfig, Publisher, Subscriber
from tools.loop import in_step
from tools.loop.shared_time import SharedTime, message_number

POSES = PosesMessage((Sighting("robot", 0.0, 0.0, 0.0, 1.0),), 0.0)
LATE_S = 0.05


@dataclass
class Wire:
    """One stream in this process, watched."""

    stack: ExitStack
    shared: SharedTime
    configs: dict[str, LinkConfig]

    def publisher(self) -> tuple[Link, Publisher[PosesMessage]]:
        link = self.configs["localizer"].open()
        return link, Publisher(link, PosesMessage)

    def subscriber(self) -> Subscriber[PosesMessage]:
        link = self.stack.enter_context(self.configs["robot"].open())
        return Subscriber(link, PosesMessage)


@pytest.fixture
def wire(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, configs: dict[str, LinkConfig]
) -> Iterator[Wire]:
    for kind, name in ((Publisher, "send"), (Subscriber, "receive"), (Subscriber, "__init__")):
        monkeypatch.setattr(kind, name, getattr(kind, name))  # put back afterwards
    for name in ("HEARTBEAT_TIMEOUT_MS", "CONNECT_TIMEOUT_MS", "SEND_QUEUE"):
        monkeypatch.setattr(sockets, name, getattr(sockets, name))
    in_step.let_sockets_wait()
    shared = SharedTime(tmp_path / "time", create=True)
    in_step._watch_streams(shared)
    with ExitStack() as stack:
        yield Wire(stack, shared, configs)


def meet(publisher: Publisher[PosesMessage], subscriber: Subscriber[PosesMessage]) -> PosesMessage:
    deadline_s = time.monotonic() + 10.0
    while True:
        sent = publisher.send(POSES)
        if subscriber.receive() is not None:
            return sent
        assert time.monotonic() < deadline_s


def test_a_message_that_was_sent_is_waited_for(wire: Wire) -> None:
    link, publisher = wire.publisher()
    with link:
        subscriber = wire.subscriber()
        last = meet(publisher, subscriber)
        # told before it is sent: the way takes a while
        wire.shared.set("pose", message_number(publisher.session, last.sequence + 1))
        timer = threading.Timer(LATE_S, publisher.send, [POSES])
        timer.start()
        got = subscriber.receive()
        timer.join()
        assert got is not None
        assert got.sequence == last.sequence + 1
        assert subscriber.receive() is None, "nothing is on its way: no waiting"


def test_a_publisher_that_was_started_anew_is_waited_for_too(wire: Wire) -> None:
    """Its numbers begin again below those of the one before."""
    link, publisher = wire.publisher()
    with link:
        subscriber = wire.subscriber()
        for _ in range(20):
            meet(publisher, subscriber)
    link, again = wire.publisher()
    with link:
        meet(again, subscriber)
        for _ in range(10):
            sent = again.send(POSES)
            got = subscriber.receive()
            assert got is not None
            assert (got.session, got.sequence) == (again.session, sent.sequence)


def test_what_is_lost_is_waited_for_once(wire: Wire, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(in_step, "LONGEST_S", 0.01)
    link, publisher = wire.publisher()
    with link:
        subscriber = wire.subscriber()
        last = meet(publisher, subscriber)
        wire.shared.set("pose", message_number(publisher.session, last.sequence + 1))
        assert subscriber.receive() is None
        monkeypatch.setattr(in_step, "LONGEST_S", 3600.0)
        assert subscriber.receive() is None
