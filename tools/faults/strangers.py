"""Who should not be heard, and what should not be said: keys, replays, floods, junk."""

from __future__ import annotations

import contextlib
import secrets
import socket
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import zmq

from robot.contract import ACTION_WHEELS
from robot.link.commands import Command, Mission
from robot.link.keys import Keys, keygen, load_keys
from robot.link.messages import UNSENT
from tools.faults.case import AGE_S, HOLD, Act, Case
from tools.faults.stage import Stage

MEGABYTE = 2**20
CALLERS = 1500
FLOOD = 300  # messages at once, ten times a second


def _stranger(stage: Stage) -> Keys:
    """Keys of its own that nobody has allowed; it knows the robot's."""
    folder = stage.bench.folder / f"stranger-{secrets.token_hex(4)}"
    own = load_keys(keygen(folder, ("monitor", "robot"))["monitor"])
    return replace(own, peers=_monitors(stage).peers)


def _monitors(stage: Stage) -> Keys:
    """A second program with the monitor's keys."""
    return load_keys(stage.bench.keys["monitor"])


def _commands(keys_of: Callable[[Stage], Keys | None], data: Callable[[Stage], list[bytes]]) -> Act:
    """Speak to the robot's ear for a second with these keys."""

    def inject(stage: Stage) -> None:
        with zmq.Context() as context, context.socket(zmq.DEALER) as socket:
            socket.linger, socket.sndhwm = 0, 10 * FLOOD
            keys = keys_of(stage)
            if keys is not None:
                socket.curve_serverkey = keys.peer("robot")
                socket.curve_publickey, socket.curve_secretkey = keys.public, keys.secret
            socket.connect(stage.bench.link_configs["robot"].endpoint("command"))
            for _ in range(10):
                for part in data(stage):
                    with contextlib.suppress(zmq.Again):
                        socket.send(part, zmq.NOBLOCK)
                stage.run(0.1)

    return inject


def _stop(_: Stage) -> list[bytes]:
    return [Command(secrets.token_hex(8), "stranger", "stop").to_bytes()]


def _old_arm(stage: Stage) -> list[bytes]:
    """What a recording of the morning's arming would hold."""
    spoken = Command("arm0", "recorded", "arm", None, None, UNSENT, 0.0)
    goal = Command("go0", "recorded", "mission", Mission(stage.goal), None, UNSENT, 0.0)
    return [spoken.to_bytes(), goal.to_bytes()]


def _junk(stage: Stage) -> list[bytes]:
    good = Command("a", "b", "arm").to_bytes()
    spoilt = bytearray(good)
    spoilt[int(stage.rng.integers(len(good)))] = int(stage.rng.integers(256))
    return [stage.rng.bytes(int(stage.rng.integers(1, 300))), bytes(spoilt)]


def _takes_over(stage: Stage) -> list[bytes]:
    """All that moves the robot or stops it."""
    asked: list[tuple[Any, ...]] = [("stop",), ("disarm",), ("arm",), ("clear",)]
    asked += [("mission", Mission(stage.goal)), ("manual", None, ACTION_WHEELS[0])]
    return [Command(secrets.token_hex(8), "thief", *words).to_bytes() for words in asked]


def _stolen(name: str, thief: str) -> Case:
    """Another machine's keys, in the hands of one who knows where the robot's ear is.

    The robot must say who tried, in its log and on the page.
    """

    def keys(stage: Stage) -> Keys:
        own = load_keys(stage.bench.keys[thief])
        return replace(own, role="monitor", peers=_monitors(stage).peers)

    def check(stage: Stage) -> str:
        told = f"the key of {thief} at 127.0.0.1 was turned away from 'command'"
        shown = [reading["name"] for reading in stage.bench.operator.robot["health"]]
        if told not in stage.bench.processes["robot"].said():
            return f"expected {told!r} in the robot's log"
        return "" if f"turned away: {thief}" in shown else f"the page does not tell: {shown}"

    inject = _commands(keys, _takes_over)
    return Case(name, "STOP, arm, mission", inject, states=(), check=check)


def _localizer_with_the_monitors_keys(stage: Stage) -> None:
    """It publishes where the robot listens, and says that it is the localizer."""
    stage.replace_localizer(replace(_monitors(stage), role="localizer"))


def _instead_of_poses(name: str, what: str, data: bytes, count: int) -> Case:
    def inject(stage: Stage) -> None:
        assert stage.stand_in is not None
        stage.stand_in.instead = [data] * count

    ready = Stage.replace_localizer
    return Case(name, what, inject, AGE_S, "overhead pose", HOLD, before=ready)


def _stopped_then_replayed(stage: Stage) -> None:
    stage.bench.operator.ask("stop")
    _commands(_monitors, _old_arm)(stage)


def _crowd(stage: Stage) -> None:
    """Connections that say nothing and stay for a second."""
    port = stage.bench.link_configs["robot"].base_port + 3
    with contextlib.ExitStack() as crowd:
        for number in range(CALLERS):
            caller = crowd.enter_context(socket.socket())
            caller.settimeout(0.05)
            caller.connect_ex(("127.0.0.1", port))
            if number % 150 == 0:
                stage.run(0.1)


def _ignored(name: str, what: str, inject: Act) -> Case:
    return Case(name, what, inject, states=())


STRANGERS = (
    _stolen("localizer's key", "localizer"),
    _stolen("robot's own key", "robot"),
    Case(
        *("monitor's key tells poses", "true ones", _localizer_with_the_monitors_keys),
        *(AGE_S, "overhead pose", HOLD),
    ),
    _ignored("wrong key", "a stranger's STOP", _commands(_stranger, _stop)),
    _ignored("no key", "a STOP without encryption", _commands(lambda _: None, _stop)),
    Case(
        *("replayed command", "STOP, then this morning's arm and mission", _stopped_then_replayed),
        *(0.0, "stop", HOLD),
    ),
    _ignored(
        *("flood of commands", f"{10 * FLOOD} a second"),
        _commands(_monitors, lambda _: [b"\0" * 100] * FLOOD),
    ),
    _ignored("crowd", f"{CALLERS} connections without a key", _crowd),
    _ignored("1 MB command", "", _commands(_monitors, lambda _: [bytes(MEGABYTE)])),
    _ignored("fuzzed commands", "", _commands(_monitors, _junk)),
    _instead_of_poses(
        "flood of poses",
        f"{10 * FLOOD} pieces of junk a second instead of poses",
        b"\0" * 99,
        FLOOD,
    ),
    _instead_of_poses("1 MB pose", "ten a second instead of poses", bytes(MEGABYTE), 1),
    Case("second monitor", "its STOP counts", _commands(_monitors, _stop), 0.1, "stop", HOLD),
)
CASES = {"strangers": STRANGERS}
