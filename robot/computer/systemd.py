"""What ends this program from outside, and what systemd is told of it.

That it is ready, that its loop turns, and in which state it is: one datagram each to the socket
that systemd names (man 3 sd_notify); no library is needed.
"""

import os
import signal
import socket
from contextlib import suppress
from typing import Callable, Mapping, Optional

from robot.parts import Tick
from robot.safety.state_machine import Verdict

PING_S = 0.5  # a quarter of the unit's WatchdogSec
Send = Callable[[str], None]


def notify_socket(environment: Mapping[str, str] = os.environ) -> Send:
    """Sends lines such as ``READY=1`` to systemd, or nowhere when it did not start this program.

    A line that cannot be delivered is dropped: systemd notices silence by itself, and the robot
    must not stop driving for it.
    """
    address = environment.get("NOTIFY_SOCKET", "")
    if not address:
        return lambda _line: None
    if address[0] == "@":  # Linux's abstract names begin with a zero byte
        address = "\0" + address[1:]
    channel = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC)
    channel.setblocking(False)

    def send(line: str) -> None:
        with suppress(OSError):
            channel.sendto(line.encode("utf-8"), address)

    return send


class Heartbeat:
    """A ``Subscriber`` that proves to systemd that the loop turns, and tells it the state.

    It is the loop itself that pings, not a thread beside it: a loop that hangs falls silent, and is
    killed and started again, DISARMED.
    """

    def __init__(self, send: Send) -> None:
        self._send = send
        self._pinged_s = float("-inf")
        self._told: Optional[Verdict] = None

    def on_tick(self, tick: Tick) -> None:
        """Ping every ``PING_S``; tell the state when it changes."""
        if not self._pinged_s <= tick.time_s < self._pinged_s + PING_S:
            self._pinged_s = tick.time_s
            self._send("WATCHDOG=1")
        if tick.verdict != self._told:
            self._told = tick.verdict
            self._send(f"STATUS={tick.verdict.state.value}: {tick.verdict.sentence}")


def on_ending(act: Callable[..., object] = signal.default_int_handler) -> None:
    """Let ``act`` happen on systemd's SIGTERM, and on SIGHUP when a terminal goes away.

    Either would kill a program at once, with the coils on; ``act`` is as Ctrl-C, so that ``with``
    blocks are left in order. A hang-up that nohup wants ignored stays so.
    """
    for number in (signal.SIGTERM, signal.SIGHUP):
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, act)
