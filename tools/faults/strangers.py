"""Who should not be heard, and what should not be said: keys, replays, floods, junk."""

import contextlib
import secrets
import socket
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import zmq

from robot.contract import ACTION_WHEELS
from robot.link.keys import Keys, keygen, load_keys
from robot.link.messages import UNSENT, Command, Mission
from tools.faults.stage import CONNECT_S, Stage


def _keys(stage: Stage, whose: str) -> Keys | None:
    """Of a second program with the monitor's keys, of one who stole another machine's and knows
    where the robot's ear is, of a stranger, whom nobody has allowed, and who knows the robot's."""
    monitors = load_keys(stage.bench.keys["monitor"])
    if whose == "stranger":
        folder = stage.bench.folder / f"stranger-{secrets.token_hex(4)}"
        own = load_keys(keygen(folder, ("monitor", "robot"))["monitor"])
        return replace(own, peers=monitors.peers)
    thief = whose.removeprefix("stolen_from_")
    if thief != whose:
        return replace(load_keys(stage.bench.keys[thief]), role="monitor", peers=monitors.peers)
    return monitors if whose == "monitor" else None


def _old_arm(stage: Stage) -> list[Command]:
    """What a recording of the morning's arming would hold."""
    goal = Command("go0", "recorded", "mission", Mission(stage.goal), None, UNSENT, 0.0)
    return [Command("arm0", "recorded", "arm", None, None, UNSENT, 0.0), goal]


def _junk(stage: Stage) -> list[bytes]:
    good = Command("a", "b", "arm").to_bytes()
    spoilt = bytearray(good)
    spoilt[int(stage.rng.integers(len(good)))] = int(stage.rng.integers(256))
    return [stage.rng.bytes(int(stage.rng.integers(1, 300))), bytes(spoilt)]


def _takes_over(stage: Stage) -> list[Command]:
    """All that moves the robot or stops it."""
    asked: list[tuple[Any, ...]] = [("stop",), ("disarm",), ("arm",), ("clear",)]
    asked += [("mission", Mission(stage.goal)), ("manual", None, ACTION_WHEELS[0])]
    return [Command(secrets.token_hex(8), "thief", *words) for words in asked]


SAYS: dict[str, Callable[[Stage], list[Any]]] = {
    "stop": lambda _: [Command(secrets.token_hex(8), "stranger", "stop")],
    "old_arm": _old_arm,
    "junk": _junk,
    "takes_over": _takes_over,
    "flood": lambda _: [b"\0" * 100] * 300,
    "megabyte": lambda _: [bytes(2**20)],
}


def speaks(stage: Stage, whose: str, what: str) -> None:
    """To the robot's ear with these keys, ten times in a second."""
    with zmq.Context() as context, context.socket(zmq.DEALER) as socket:
        socket.linger, socket.sndhwm = 0, 3000
        keys = _keys(stage, whose)
        if keys is not None:
            socket.curve_serverkey = keys.peer("robot")
            socket.curve_publickey, socket.curve_secretkey = keys.public, keys.secret
        socket.connect(stage.bench.link_configs["robot"].endpoint("command"))
        for turn in range(20):
            for part in () if turn % 2 else SAYS[what](stage):
                data = part.to_bytes() if isinstance(part, Command) else part
                with contextlib.suppress(zmq.Again):
                    socket.send(data, zmq.NOBLOCK)
            time.sleep(6.0 * CONNECT_S if turn < 4 else 0.0)  # shaking hands takes real time
            stage.run(0.05)


def named(stage: Stage, thief: str) -> str:
    """Whether the robot says who tried, in its log and on the page."""
    told = f"the key of {thief} at 127.0.0.1 was turned away from 'command'"
    shown = [reading["name"] for reading in stage.bench.operator.robot["health"]]
    if told not in stage.bench.processes["robot"].said():
        return f"expected {told!r} in the robot's log"
    return "" if f"turned away: {thief}" in shown else f"the page does not tell: {shown}"


def localizer_with_monitors_keys(stage: Stage) -> None:
    """It publishes where the robot listens, and says that it is the localizer."""
    stage.replace_localizer(replace(load_keys(stage.bench.keys["monitor"]), role="localizer"))


def instead(stage: Stage, size: int, count: int) -> None:
    """So many pieces of junk of this size, each time in place of poses."""
    stage.stand_in.instead = [bytes(size)] * count


def replayed(stage: Stage) -> None:
    """A person stops the robot; then somebody says what they said this morning."""
    stage.bench.operator.ask("stop")
    speaks(stage, "monitor", "old_arm")


def crowd(stage: Stage, callers: int) -> None:
    """Connections that say nothing and stay for a second."""
    port = stage.bench.link_configs["robot"].base_port + 3
    with contextlib.ExitStack() as crowd:
        for number in range(callers):
            caller = crowd.enter_context(socket.socket())
            caller.settimeout(0.05)
            caller.connect_ex(("127.0.0.1", port))
            if number % 150 == 0:
                stage.run(0.1)
