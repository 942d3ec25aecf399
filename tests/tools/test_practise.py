from __future__ import annotations

import io

import pytest

from tools.practise import ROBOTS, main, practise


def test_a_fault_can_be_seen_and_ends_the_test(capsys: pytest.CaptureFixture[str]) -> None:
    answers = iter(["y", "n", "n", "n"])  # hangs free; not forward; not again; not on
    assert practise(ROBOTS["left-reversed"], lambda prompt: next(answers)) == 1
    told = capsys.readouterr().out
    assert "you see: left -1 turns, right +0 turns, coils on" in told
    assert "FAIL  left forward: the other wheel moved" in told


def test_without_a_person_it_says_so(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO())
    assert main([]) == 2
    assert "expected a person who answers" in capsys.readouterr().err
