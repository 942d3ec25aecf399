from __future__ import annotations

import socket
from pathlib import Path
from typing import List

from robot.computer.systemd import PING_S, Heartbeat, notify_socket
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
