"""The table of faults itself: complete, told apart, reported."""

from __future__ import annotations

from pathlib import Path

import pytest

from robot.output import write_json
from robot.safety.state_machine import State
from robot.typed_config import to_plain
from tools.faults import __main__ as faults
from tools.faults import meet
from tools.faults.case import Outcome
from tools.faults.cli import FaultsOptions
from tools.faults.report import write_report
from tools.loop import __main__ as loop

STOPPED = Outcome("camera", "stops", "none", 0.26, 0.2, "FAULT", "frame | old; is it covered?", "")
ALIKE = Outcome("camera", "hangs", "", 0.5, 0.6, "FAULT", "frame | old; clean it", "")
DRIVES = Outcome("network", "late", "", None, 0.0, "AUTO", "auto, by a person", "")
FAILED = Outcome("network", "cut", "", 9.0, 1.0, "AUTO", "", "still moving")
# Poses that drift by 3 cm/s are 8 cm off a quarter of a second later; by 3 degrees a second, 15.
# A picture that is rolled or shifted a little is most like a bend.
SLOW_S = {
    **{f"drift {way}": 2.4 for way in ("ahead", "back", "left", "right")},
    **{f"drift {way} in a bend": 2.4 for way in ("ahead", "left")},
    "headings turn": 5.0,
    "other stops": 5.0,
    "other's link dies": 6.0,
    "rolled": 6.0,
    "shifted": 6.0,
}


def test_every_case_has_its_own_name_and_states_that_exist() -> None:
    states = {state.value for state in State}
    every = meet.every_case()
    assert len({(case.family, case.name) for case in every}) == len(every) > 90
    for case in every:
        assert set(case.states) <= states, case.name
        assert case.threshold_s <= SLOW_S.get(case.name, 2.0)


def test_the_report_shows_stops_dashes_and_failures(tmp_path: Path) -> None:
    path = tmp_path / "faults.md"
    write_report([STOPPED, ALIKE, DRIVES, FAILED], path)
    text = path.read_text(encoding="utf-8")
    assert "| stops: none | 200 | 260 | FAULT: frame \\| old |\n| hangs | 600 | 500 | ″ |" in text
    assert "| late | – | – | AUTO |\n| cut | 1000 | 9000 | **still moving** AUTO: " in text
    assert "3 of 4 passed" in text


def test_cases_are_chosen_by_family_and_name() -> None:
    options = FaultsOptions(Path("m.onnx"), family=("camera",), case=("stops",))
    assert [(case.family, case.name) for case in meet.chosen(options)] == [("camera", "stops")]


def test_by_sight_alone_nobody_asks_what_the_localizer_tells() -> None:
    model = Path("nav.onnx")
    every, seen = (meet.chosen(FaultsOptions(model, sight)) for sight in (None, Path("s.onnx")))
    names = {(case.family, case.name) for case in seen}
    assert ("camera", "stops") in names
    assert not any(family in ("localizer", "traffic") for family, _ in names)
    assert not names & {("network", "poses cut"), ("ways", "drift left"), ("ways", "swapped")}
    for name, limit_s, by_sight_s in (("turned round", 1.0, 4.0), ("stops", 0.2, 0.2)):
        (of_all,), (of_seen,) = ([c for c in each if c.name == name] for each in (every, seen))
        assert (of_all.threshold_s, of_seen.threshold_s) == (limit_s, by_sight_s)


def test_wrong_input_ends_with_status_2(capsys: pytest.CaptureFixture) -> None:
    assert faults.main(["--model", "m.onnx", "--case", "stop"]) == 2
    assert "did you mean" in capsys.readouterr().err
    assert loop.main(["--missions", "0", "--model", "m.onnx"]) == 2


def test_outcomes_are_read_again_as_they_were(tmp_path: Path) -> None:
    every = [STOPPED, ALIKE, DRIVES, FAILED]
    write_json(tmp_path / "faults.json", {"schema": 1, "outcomes": to_plain(every)})
    assert meet._done(tmp_path / "faults.json") == every
