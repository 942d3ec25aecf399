"""The command that replays a recording, by its exit status and what it says."""

import json
from pathlib import Path

import pytest

from tests.robot.tiny_onnx import lane_contract, write_policy
from tools.replay import main

GOLDEN = Path(__file__).parents[1] / "data" / "golden_drive.mcap"


def test_a_recording_that_comes_out_alike(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([str(GOLDEN)]) == 0
    assert "34 decisions of 34 turns replayed" in capsys.readouterr().out


def test_another_policy_decides_otherwise(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = write_policy(tmp_path / "other.onnx", lane_contract())
    assert main([str(GOLDEN), "--model", str(other), "--json"]) == 1
    found = json.loads(capsys.readouterr().out)
    assert len(found["differences"]) == found["decisions"] == 34


def test_what_is_no_recording_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "notes.mcap").write_text("nothing of the kind")
    assert main([str(tmp_path / "notes.mcap")]) == 2
    assert "expected an MCAP recording" in capsys.readouterr().err
