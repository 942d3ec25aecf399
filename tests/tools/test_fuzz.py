"""A short run of the fuzzer; the long one is a command."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from robot.errors import ContractError
from robot.link.messages import PosesMessage
from tools.fuzz import KINDS, Fuzzer, seeds


def test_decoders_hold_against_mutated_messages() -> None:
    fuzzer = Fuzzer(np.random.default_rng(1), seeds())
    first = len(fuzzer.found.lines)
    fuzzer.run(2000, lambda _: None)
    found = fuzzer.found
    assert found.failures == []
    assert found.read > 10
    assert len(found.lines) > first, "it gets deeper than the good messages"
    assert len(fuzzer.corpus) > len(seeds())


def test_every_kind_of_message_is_a_seed() -> None:
    assert {kind for _, kind in seeds()} == set(KINDS)
    for data, kind in seeds():
        assert kind.from_bytes(data).to_bytes() == data


def test_a_decoder_that_breaks_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    honest: Any = PosesMessage.from_bytes

    def fragile(data: bytes) -> PosesMessage:
        try:
            return honest(data)
        except ContractError:
            raise KeyError("lost") from None

    monkeypatch.setattr(PosesMessage, "from_bytes", staticmethod(fragile))
    fuzzer = Fuzzer(np.random.default_rng(1), seeds())
    fuzzer.run(200, lambda _: None)
    assert any("KeyError" in what for _, what in fuzzer.found.failures)
