"""The table of faults itself: complete, told apart, reported."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from robot.cli.install import SHIPPED_MODEL as LANE_KEEPER
from robot.errors import ConfigError, ContractError
from robot.output import write_json
from robot.safety.state_machine import State
from robot.typed_config import to_plain
from sim_pybullet.virtual.pca9685_registers import Pca9685Registers
from sim_pybullet.virtual.world import VirtualWorld
from tools.faults import __main__ as faults
from tools.faults import meet
from tools.faults.case import Case, Outcome, case_of, sets
from tools.faults.cli import FaultsOptions
from tools.faults.report import write_report
from tools.faults.stage import Stage
from tools.loop import __main__ as loop
from tools.loop.bench import Bench
from tools.loop.operator import Operator

ACTS_ON = {  # by the names of their places on a stage
    "bench": Bench,
    "bench.second": Operator,
    "bench.town.hat.chip": Pca9685Registers,
    "bench.town.world": VirtualWorld,
}
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


@pytest.fixture
def benches(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """What is asked of each bench; on it the camera's cases fail, with FAULT."""
    asked: list[Any] = []

    class Quick:
        def __init__(self, options: object, _: Path) -> None:
            asked.append(options)

        def __enter__(self) -> Quick:
            return self

        def __exit__(self, *_: object) -> None:
            pass

        def play(self, case: Case) -> Outcome:
            wrong = "late" * (case.family == "camera")
            return Outcome(case.family, case.name, case.what, state="FAULT", problem=wrong)

    monkeypatch.setattr(meet, "Stage", Quick)
    monkeypatch.setattr(meet, "expect_navigator", lambda _: None)
    monkeypatch.setattr(meet, "OnnxSight", lambda _: None)
    return asked


def test_one_fault_that_is_not_met_ends_with_status_1(benches: list[Any], tmp_path: Path) -> None:
    path, report = tmp_path / "faults.json", tmp_path / "faults.md"
    options = FaultsOptions(Path("m.onnx"), family=("network",), json=path, report=report)
    assert meet.meet(options) == 0
    assert "camera stops" in report.read_text(encoding="utf-8"), "of what was not played"
    assert meet.meet(replace(options, family=("network", "camera"))) == 1
    played = {(outcome.family, outcome.name) for outcome in meet._done(path)}
    every = {(case.family, case.name) for case in meet.every_case()}
    assert played == {each for each in every if each[0] in ("network", "camera")}
    assert len(benches) == 2, "what was met before is not met again"


def test_a_fault_of_one_name_in_another_family_is_not_this_one(
    benches: list[Any], tmp_path: Path
) -> None:
    path, options = tmp_path / "faults.json", FaultsOptions(Path("m.onnx"), family=("network",))
    names = {case.name for case in meet.chosen(options)}
    others = [Outcome("camera", name, "") for name in names]
    write_json(path, {"schema": 1, "outcomes": to_plain(others)})
    meet.meet(replace(options, json=path))
    assert {(o.family, o.name) for o in meet._done(path)} >= {("network", name) for name in names}


@pytest.mark.usefixtures("benches")
def test_neither_the_model_nor_what_is_none_of_ours_is_written_over(tmp_path: Path) -> None:
    model, odd = tmp_path / "m.onnx", tmp_path / "odd.json"
    model.write_bytes(b"a model")
    write_json(odd, {"rows": []})
    options = FaultsOptions(model, family=("network",))
    for path, wrong in ((model, replace(options, report=model)), (odd, replace(options, json=odd))):
        told = path.read_bytes()
        with pytest.raises(ConfigError):
            meet.meet(wrong)
        assert path.read_bytes() == told


def test_a_policy_that_is_no_navigator_meets_no_fault(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(meet, "_play", lambda *_: pytest.fail("it was played"))
    with pytest.raises((ConfigError, ContractError)):
        meet.meet(FaultsOptions(LANE_KEEPER, family=("network",)))


def test_by_sight_alone_no_localizer_runs(benches: list[Any]) -> None:
    for sight in (None, Path("s.onnx")):
        meet.meet(FaultsOptions(Path("m.onnx"), family=("network",), sight=sight))
    assert [bench.localizer for bench in benches] == [True, False]


def test_an_act_or_a_look_of_the_table_is_one_of_the_case() -> None:
    acts = {name: lambda _: "" for name in ("breaks", "sets_off", "nears", "looks")}
    row = {"breaks": None, "before": "sets_off", "approach": "nears", "check": {"looks": None}}
    case = case_of("camera", {"name": "n", "what": "w", **row}, acts)
    assert (case.before, case.approach, case.states) == (
        acts["sets_off"],
        acts["nears"],
        ("FAULT",),
    )
    assert len(case.check) == 1


def test_what_is_set_for_a_fault_is_set_back() -> None:
    stage = SimpleNamespace(part=SimpleNamespace(late_s=0.0))
    with sets(cast(Stage, stage), "part", late_s=2.0):
        assert stage.part.late_s == 2.0
    assert stage.part.late_s == 0.0


def test_what_the_table_calls_by_its_place_is_there() -> None:
    """A chip that lost its supply had no such method for days, and no quick test noticed."""
    table = (Path(faults.__file__).parent / "cases.yaml").read_text(encoding="utf-8")
    called = set(re.findall(r"\b(bench(?:\.[a-z_]+)*)\.([a-z_]+):", table))
    assert called >= {("bench.town.hat.chip", "power_cycle"), ("bench", "freeze")}
    assert [act for place, act in called if not callable(getattr(ACTS_ON[place], act, None))] == []
