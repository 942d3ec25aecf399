from __future__ import annotations

import signal
import socket
import threading
from dataclasses import replace
from pathlib import Path
from typing import List

from robot.computer.systemd import PING_S, Heartbeat, notify_socket, on_ending
from robot.safety.state_machine import Command
from tests.robot.runtime.test_loop import Bench


def test_lines_reach_the_socket_that_systemd_names(tmp_path: Path) -> None:
    for address in (str(tmp_path / "notify"), f"\0duckpilot-{tmp_path}"):
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listener:
            listener.settimeout(5.0)
            listener.bind(address)
            send = notify_socket({"NOTIFY_SOCKET": address.replace("\0", "@")})
            send("READY=1")
            assert listener.recv(100) == b"READY=1"


def test_without_systemd_there_is_nobody_to_tell() -> None:
    notify_socket({})("READY=1")


def test_a_systemd_that_went_away_stops_no_robot(tmp_path: Path) -> None:
    send = notify_socket({"NOTIFY_SOCKET": str(tmp_path / "gone")})
    send("WATCHDOG=1")


def test_only_a_turning_loop_pings_and_changes_of_state_are_told_once() -> None:
    bench, lines = Bench(), []  # type: ignore[var-annotated]
    heart = Heartbeat(lines.append)
    pings: List[int] = []
    for second in range(20):
        bench.turn()
        heart.on_tick(bench.heard.ticks[-1])
        pings.append(lines.count("WATCHDOG=1"))
        if second == 9:
            assert bench.runtime.ask(Command.ARM).accepted
    turns_per_ping = PING_S / 0.1
    assert pings[-1] >= 20 / turns_per_ping - 1
    assert pings[-1] <= 20 / turns_per_ping + 1
    told = [line for line in lines if line.startswith("STATUS=")]
    assert told == ["STATUS=DISARMED: started; a person must arm", "STATUS=READY: arm, by a person"]


def test_a_systemd_that_does_not_read_holds_up_no_loop(tmp_path: Path) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listener:
        listener.bind(str(tmp_path / "notify"))
        send = notify_socket({"NOTIFY_SOCKET": str(tmp_path / "notify")})
        loop = threading.Thread(target=lambda: [send("WATCHDOG=1") for _ in range(2000)])
        loop.daemon = True  # a loop that hangs here ends with the listener at the latest
        loop.start()
        loop.join(10.0)
        assert not loop.is_alive()


def test_it_pings_every_half_second_and_at_once_when_time_went_back() -> None:
    bench, lines = Bench(), []  # type: ignore[var-annotated]
    bench.turn()
    heart, tick = Heartbeat(lines.append), bench.heard.ticks[-1]
    for time_s, pings in ((100.0, 1), (100.4, 1), (100.5, 2), (100.9, 2), (101.0, 3), (7.0, 4)):
        heart.on_tick(replace(tick, time_s=time_s))
        assert lines.count("WATCHDOG=1") == pings, time_s


def test_the_same_state_for_another_reason_is_told() -> None:
    bench, lines = Bench(), []  # type: ignore[var-annotated]
    bench.turn()
    heart, tick = Heartbeat(lines.append), bench.heard.ticks[-1]
    for sentence in ("clear, by a person", "clear, by a person", "disarm, by a person"):
        heart.on_tick(replace(tick, verdict=tick.verdict._replace(sentence=sentence)))
    told = [line for line in lines if line.startswith("STATUS=")]
    assert told == [f"STATUS=DISARMED: {why}, by a person" for why in ("clear", "disarm")]


def test_what_ends_a_program_is_as_ctrl_c_where_nothing_else_is_told() -> None:
    """Not by default: a program that systemd or a terminal ends at once leaves the coils on."""
    before = {number: signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGHUP)}
    try:
        for number in before:
            signal.signal(number, signal.SIG_DFL)
        on_ending()
        for number in before:
            assert signal.getsignal(number) is signal.default_int_handler
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
