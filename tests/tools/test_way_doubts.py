"""Honest drives are not doubted; ``python -m tools.way_doubts --missions 300`` drives more."""

from __future__ import annotations

import json

import pytest

from tools.way_doubts import main


@pytest.mark.parametrize("look", ["randomised", "reality"])
def test_no_honest_mission_is_doubted(look: str, capsys: pytest.CaptureFixture) -> None:
    assert main(["--look", look, "--missions", "16", "--seed", "3"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["missions"] == 16
    assert told["driven_s"] > 200.0
    assert (told["doubted"], told["at_bound"]) == (0, 0)
    assert 0.1 < told["coarse_max"] < 0.9
    assert told["fine_max"] < 0.9
