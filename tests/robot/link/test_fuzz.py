"""Whatever bytes come, a decoder reads them or refuses them."""

from __future__ import annotations

import re
from typing import Any, List, Tuple

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robot.errors import ContractError
from robot.link.messages import (
    Ack,
    Command,
    FrameMessage,
    InputAge,
    Mission,
    MissionStatus,
    PosesMessage,
    Reading,
    Sighting,
    Telemetry,
)
from tests.thorough import count

MISSION = MissionStatus("m1", (1.0, 2.0), "driving", 0.5, 1.2, -0.01, "on its way")
GOOD: Tuple[Any, ...] = (
    PosesMessage((Sighting("duck", 1.0, 2.0, 0.5, 0.9),), 10.0, "abcd", 7, 10.1),
    PosesMessage((Sighting("goose", 0.4, 0.6, None, 0.8),), 10.0, "abcd", 7, 10.1),
    Telemetry(
        *("duck", "AUTO", "auto, by a person", 2, (0.1, 0.2, 0.9, 0.0, -1.0), (1.0, 2.0, 0.5)),
        path=((0.0, 0.0), (1.0, 2.0)),
        mission=MISSION,
        inputs=(InputAge("camera", 0.03, 0.2), InputAge("pose", None, 1.0)),
        health=(Reading("load", 0.7), Reading("disk free", 40.0, "%", "ok")),
        map="arena",
    ),
    FrameMessage(b"\xff\xd8 picture \xff\xd9", 1.0, "eye", 4, 1.1),
    Command("c1", "page", "mission", Mission((1.0, 2.0), (0.0, 0.5))),
    Command("c2", "page", "manual", None, (0.3, -0.1)),
    Ack("c1", False, "not possible in DISARMED", "abcd", 5.0),
)
KINDS = [PosesMessage, Telemetry, FrameMessage, Command, Ack]
# Instead of a value of the JSON, or anywhere among the bytes.
JUNK: List[bytes] = [
    *(b"null", b"true", b"NaN", b"Infinity", b"1e999", b"-0.0", b"-1", b"9007199254740993"),
    *(b"{}", b"[]", b"[[[[[[[[", b"[1,2]", b'"schema":1', b'"\\ud800"', b"\xc3\x28", b"\x00", b","),
    *(b"\"'", b"\xff\xd8\xff\xd9", b"", b"1.5", b'"abc"'),
]
VALUE = re.compile(rb'":(\[[^\]]*\]|"[^"]*"|[^,"\]}{]+)')


@st.composite
def mutated(draw: Any) -> Tuple[bytes, Any]:
    """A good message with one to four changes, and who is to read it: mostly its own decoder."""
    message = draw(st.sampled_from(GOOD))
    data, kind = message.to_bytes(), draw(st.sampled_from([type(message)] * 9 + KINDS))
    for _ in range(draw(st.integers(1, 4))):
        junk = draw(st.sampled_from(JUNK) | st.binary(max_size=4))
        spans = [found.span(1) for found in VALUE.finditer(data)]
        if spans and draw(st.booleans()):
            start, end = draw(st.sampled_from(spans))
        else:
            start = draw(st.integers(0, len(data)))
            end = start + draw(st.integers(0, 20))
        data = data[:start] + junk + data[end:]
    return data, kind


def held(data: bytes, kind: Any) -> bool:
    """Whether it was read; what is read must come through the wire once more as it was."""
    try:
        message = kind.from_bytes(data)
    except ContractError:
        return False
    again = kind.from_bytes(message.to_bytes())
    assert again == message or again.to_bytes() == message.to_bytes()
    return True


@settings(max_examples=count(400, 1500), deadline=None)
@given(mutated())
def test_decoders_hold_against_mutated_messages(found: Tuple[bytes, Any]) -> None:
    held(*found)


@pytest.mark.parametrize("message", GOOD, ids=lambda message: type(message).__name__)
def test_every_value_may_be_exchanged_for_junk(message: Any) -> None:
    """Some of it must be read, or nothing but syntax was tried."""
    data, read = message.to_bytes(), 0
    assert held(data, type(message))
    for found in VALUE.finditer(data):
        for junk in JUNK:
            read += held(data[: found.start(1)] + junk + data[found.end(1) :], type(message))
    assert read > 0
