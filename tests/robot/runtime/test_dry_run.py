"""What the measurement of the loop tells is in the units of its keys."""

from __future__ import annotations

import json
import time
from itertools import count
from pathlib import Path
from types import SimpleNamespace

import pytest

from robot.contract import PolicyContract
from robot.geometry import STILL
from robot.runtime import dry_run
from robot.safety.state_machine import State
from tests.robot.tiny_onnx import lane_contract, navigation_contract, write_policy

LAGS_S, DURATIONS_S = (0.001, 0.003, 0.002), (0.06, 0.01, 0.02)


def test_lags_and_turns_are_told_in_ms_and_memory_in_mb(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    turns = count()

    def step(_lag_s: float) -> SimpleNamespace:
        turn = next(turns)
        return SimpleNamespace(lag_s=LAGS_S[turn], duration_s=DURATIONS_S[turn])

    monkeypatch.setattr(dry_run, "dry_runtime", {Path("m.onnx"): SimpleNamespace(step=step)}.get)
    dry_run.tell(time.perf_counter(), "m.onnx", "0.3")
    told = json.loads(capsys.readouterr().out)
    assert told["loop"] == {
        "turns": 3,
        "lag_p50_ms": pytest.approx(2.0),
        "lag_p99_ms": pytest.approx(2.98),
        "lag_max_ms": pytest.approx(3.0),
        "turn_p50_ms": pytest.approx(20.0),
        "turn_p99_ms": pytest.approx(59.2),
    }
    assert 10.0 < told["robot"]["rss_mb"] < 100_000.0


@pytest.mark.parametrize("contract", [lane_contract(), navigation_contract()])
def test_what_is_measured_is_a_robot_that_drives(contract: PolicyContract, tmp_path: Path) -> None:
    runtime = dry_run.dry_runtime(write_policy(tmp_path / "m.onnx", contract))
    tick = [runtime.step() for _ in range(3)][-1]
    assert (tick.verdict.state, tick.wheels == STILL) == (State.AUTO, False)
