"""A drive of the shipped policy, decided again by today's robot on whatever computer this is.

Its least clear decision is clear by four times the tolerance of a replay elsewhere, so every one
must come out the same on any processor and with any onnxruntime.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from robot.recording.reader import read_turns
from robot.recording.replay import TOLERANCE, replay

pytest.importorskip("mcap")

GOLDEN = Path(__file__).parents[2] / "data" / "golden_drive.mcap"


def test_the_golden_drive_is_decided_as_it_was() -> None:
    found = replay(GOLDEN)
    assert found.differences == []
    assert found.decisions == found.turns >= 30
    assert found.close == 0
    margins = [turn.margin for turn, _ in read_turns(GOLDEN) if turn.values is not None]
    assert min(margin or 0.0 for margin in margins) > 4.0 * TOLERANCE
    actions = {turn.action for turn, _ in read_turns(GOLDEN)}
    assert len(actions) >= 3
    states = {turn.state for turn, _ in read_turns(GOLDEN)}
    assert states == {"AUTO"}
