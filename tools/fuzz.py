"""``python -m tools.fuzz``: whatever bytes come, a decoder reads them or refuses them.

Coverage-guided mutation (Zalewski, American fuzzy lop): inputs that reach new lines of the decoders
are kept and mutated further. Tracing is slow, so only a share of the inputs is traced, and all that
are refused in a new way.
"""

from __future__ import annotations

import argparse
import json
import re
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
from tqdm import tqdm

from robot import typed_config
from robot.command_line import SEED, OneLineParser, answer, whole
from robot.errors import ContractError
from robot.link import commands, messages, telemetry, wire
from robot.link.commands import Ack, Command, Mission
from robot.link.messages import FrameMessage, PosesMessage, Sighting
from robot.link.telemetry import Attention, InputAge, MissionStatus, Reading, Telemetry
from robot.output import expect_writable, write_json

TRACED = 1 / 32  # share of the inputs
CORPUS = 4096
OTHER_DECODER = 0.1
FILES = {m.__file__ for m in (typed_config, commands, messages, telemetry, wire)}
TOKENS = (
    b'{}[]",:',
    b"null",
    b"true",
    b"NaN",
    b"Infinity",
    b"1e999",
    b"-0.0",
    b"9007199254740993",
    b'"schema":1',
    b'"\\ud800"',
    b"\xc3\x28",
    b"\x00",
    b"[[[[[[[[",
    b"DPFR\x00\x01",
    b"\xff\xd8\xff\xd9",
)
Line = tuple[str, int]
KINDS: tuple[Any, ...] = (PosesMessage, Telemetry, FrameMessage, Command, Ack)


def seeds() -> list[tuple[bytes, Any]]:
    """Good messages of every kind, with every field set, and their decoders."""
    mission = MissionStatus("m1", (1.0, 2.0), "driving", 0.5, 1.2, -0.01, "on its way")
    report = Telemetry(
        *("duck", "AUTO", "auto, by a person", 2, (0.1, 0.2, 0.9, 0.0, -1.0), (1.0, 2.0, 0.5)),
        path=((0.0, 0.0), (1.0, 2.0)),
        mission=mission,
        inputs=(InputAge("camera", 0.03, 0.2), InputAge("pose", None, 1.0)),
        health=(Reading("load", 0.7), Reading("disk free", 40.0, "%", "ok")),
        attention=Attention.from_array(np.eye(4)),
        map="arena",
    )
    seen = Sighting("duck", 1.0, 2.0, 0.5, 0.9), Sighting("goose", 0.4, 0.6, None, 0.8)
    every = (
        PosesMessage(seen, 10.0, "abcd", 7, 10.1),
        report,
        FrameMessage(b"\xff\xd8 picture \xff\xd9", 160, 120, 1.0, "eye", 4, 1.1),
        Command("c1", "page", "mission", Mission((1.0, 2.0), (0.0, 0.5))),
        Command("c2", "page", "manual", None, 2),
        Ack("c1", False, "not possible in DISARMED", "abcd", 5.0),
    )
    return [(message.to_bytes(), type(message)) for message in every]


@dataclass
class Findings:
    """What a run saw."""

    executions: int = 0
    read: int = 0
    refused: int = 0
    seconds: float = 0.0
    lines: set[Line] = field(default_factory=set)
    refusals: set[str] = field(default_factory=set)  # by decoder and lines
    failures: list[tuple[str, str]] = field(default_factory=list)  # input (hex), what happened


class Fuzzer:
    """Mutates a corpus of messages and gives them to every decoder.

    Args:
        rng: draws the mutations.
        corpus: what to begin with.
    """

    def __init__(self, rng: np.random.Generator, corpus: list[tuple[bytes, Any]]) -> None:
        self.corpus = [data for data, _ in corpus]
        self.found = Findings()
        self._kinds = [kind for _, kind in corpus]  # of the corpus
        self._rng = rng
        for data, _ in corpus:
            self._traced(data)

    def run(self, count: int, progress: Callable[[int], object]) -> None:
        """Try ``count`` inputs, each with one decoder."""
        began_s, told = time.monotonic(), 0
        traced = self._rng.random(count) < TRACED
        for number in range(count):
            data, kind = self._mutated()
            where = self._try(data, kind)
            new = where not in self.found.refusals
            if new or traced[number]:
                self.found.refusals.add(where)
                if (self._traced(data) or new) and len(self.corpus) < CORPUS:
                    self.corpus.append(data)
                    self._kinds.append(kind)
            if number % 5000 == 4999:
                progress(number + 1 - told)
                told = number + 1
        progress(count - told)
        self.found.seconds += time.monotonic() - began_s

    def _try(self, data: bytes, kind: Any) -> str:
        """Decode; where it was refused, "" when it was read."""
        self.found.executions += 1
        try:
            message = kind.from_bytes(data)
            again = kind.from_bytes(message.to_bytes())
        except ContractError as error:
            self.found.refused += 1
            return _where(kind, error)
        except Exception as error:  # noqa: BLE001  whatever it is, it is a finding
            self.found.failures.append((data.hex(), f"{kind.__name__}: {error!r}"))
            return ""
        self.found.read += 1
        if again != message and not _rounded(again, message):
            self.found.failures.append((data.hex(), f"{kind.__name__}: not the same when sent on"))
        return ""

    def _traced(self, data: bytes) -> bool:
        """Decode with every decoder, noting lines; whether one was new."""
        before = len(self.found.lines)
        sys.settrace(self._enter)
        try:
            for kind in KINDS:
                self._try(data, kind)
        finally:
            sys.settrace(None)
        return len(self.found.lines) > before

    def _enter(self, frame: FrameType, _event: str, _argument: Any) -> Any:
        if frame.f_code.co_filename not in FILES:
            return None
        return self._line

    def _line(self, frame: FrameType, event: str, _: Any) -> Any:
        if event == "line":
            self.found.lines.add((frame.f_code.co_filename, frame.f_lineno))
        return self._line

    def _mutated(self) -> tuple[bytes, Any]:
        """An input, and who is to read it: mostly the decoder that it was made for."""
        rng = self._rng
        number = int(rng.integers(len(self.corpus)))
        data, kind = bytearray(self.corpus[number]), self._kinds[number]
        if rng.random() < OTHER_DECODER:
            kind = KINDS[int(rng.integers(len(KINDS)))]
        for _ in range(int(rng.geometric(0.6))):
            MUTATIONS[int(rng.integers(len(MUTATIONS)))](data, rng, self.corpus)
        return bytes(data), kind


def _where(kind: Any, error: ContractError) -> str:
    """The decoder, and the lines that it came by to the refusal."""
    lines, trace = [], error.__traceback__
    while trace is not None:
        lines.append(str(trace.tb_lineno))
        trace = trace.tb_next
    return f"{kind.__name__}: {' '.join(lines)}"


def _rounded(one: Any, other: Any) -> bool:
    """Whether two messages are the same to the digits that are sent."""
    return bool(one.to_bytes() == other.to_bytes())


def _at(data: bytearray, rng: np.random.Generator) -> int:
    return int(rng.integers(len(data) + 1))


def _flip(data: bytearray, rng: np.random.Generator, _: list[bytes]) -> None:
    if data:
        data[_at(data, rng) - 1] ^= 1 << int(rng.integers(8))


def _byte(data: bytearray, rng: np.random.Generator, _: list[bytes]) -> None:
    if data:
        data[_at(data, rng) - 1] = int(rng.integers(256))


def _cut(data: bytearray, rng: np.random.Generator, _: list[bytes]) -> None:
    start = _at(data, rng)
    del data[start : start + int(rng.integers(1, 20))]


def _double(data: bytearray, rng: np.random.Generator, _: list[bytes]) -> None:
    start = _at(data, rng)
    data[start:start] = data[start : start + int(rng.integers(1, 40))]


def _token(data: bytearray, rng: np.random.Generator, _: list[bytes]) -> None:
    start = _at(data, rng)
    data[start:start] = TOKENS[int(rng.integers(len(TOKENS)))]


def _digit(data: bytearray, rng: np.random.Generator, _: list[bytes]) -> None:
    places = [i for i, value in enumerate(data) if 48 <= value <= 57]
    if places:
        data[places[int(rng.integers(len(places)))]] = b"01234567890123456789-.eE"[
            int(rng.integers(24))
        ]


def _value(data: bytearray, rng: np.random.Generator, corpus: list[bytes]) -> None:
    """Exchange a JSON value for one of another message."""
    values = [m.span(1) for m in _VALUE.finditer(bytes(data))]
    others = _VALUE.findall(corpus[int(rng.integers(len(corpus)))])
    if values and others:
        start, end = values[int(rng.integers(len(values)))]
        data[start:end] = others[int(rng.integers(len(others)))]


def _splice(data: bytearray, rng: np.random.Generator, corpus: list[bytes]) -> None:
    other = corpus[int(rng.integers(len(corpus)))]
    data[_at(data, rng) :] = other[int(rng.integers(len(other) + 1)) :]


_VALUE = re.compile(rb'":(\[[^\]]*\]|"[^"]*"|[^,"\]}{]+)')
# Half of them leave JSON whole: else little would get past the parser.
MUTATIONS = (_flip, _byte, _cut, _double, _token, _splice, *(_digit, _value) * 3)


def lines_of_decoders() -> int:
    """How many lines the traced files have that can be executed."""
    count = 0
    for name in FILES:
        assert name is not None
        codes = [compile(Path(name).read_text(encoding="utf-8"), name, "exec")]
        while codes:
            code = codes.pop()
            codes += [c for c in code.co_consts if hasattr(c, "co_lines")]
            if code.co_name != "<module>":
                count += len({line for _, _, line in code.co_lines() if line})
    return count


def main(arguments: list[str] | None = None) -> int:
    """Exit status 0 when every decoder held, 1 otherwise."""
    parser = OneLineParser(prog="python -m tools.fuzz", description=__doc__)
    parser.add_argument("--count", type=whole(1, 10**9), default=1_000_000, help="inputs")
    parser.add_argument("--seed", type=SEED, default=0)
    parser.add_argument("--json", type=Path, help="write the figures")
    options = parser.parse_args(arguments)
    return answer("fuzz", lambda: fuzz(options))


def fuzz(options: argparse.Namespace) -> int:
    """Try as asked; 1 where a decoder failed. ConfigError where the figures cannot be written."""
    expect_writable(options.json)
    fuzzer = Fuzzer(np.random.default_rng(options.seed), seeds())
    with tqdm(total=options.count, desc="messages") as bar:
        fuzzer.run(options.count, bar.update)
    found = fuzzer.found
    figures = {
        "schema": 1,
        "inputs": {"count": options.count, "seed": options.seed},
        "executions": found.executions,
        "read": found.read,
        "refused": found.refused,
        "lines_reached": len(found.lines),
        "lines": lines_of_decoders(),
        "corpus": len(fuzzer.corpus),
        "ways_of_refusing": len(found.refusals),
        "seconds": found.seconds,
        "failures": found.failures[:100],
    }
    print(json.dumps(figures, indent=1))
    if options.json:
        write_json(options.json, figures)
    return 1 if found.failures else 0


if __name__ == "__main__":
    sys.exit(main())
