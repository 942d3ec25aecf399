"""The table of faults itself: complete, told apart, reported."""

from __future__ import annotations

import re
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from robot.output import write_json
from robot.safety.state_machine import State
from robot.typed_config import to_plain
from sim_pybullet.virtual.pca9685_registers import Pca9685Registers
from sim_pybullet.virtual.world import VirtualWorld
from tools.faults import __main__ as faults
from tools.faults import meet
from tools.faults.case import Case, Outcome, nothing
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


FAULT = Case("camera", "stops", "", nothing, threshold_s=0.2, says="frame")


class Seen(Stage):
    """A robot of which only is known when its motors stepped and what is shown; no bench."""

    def __init__(self, steps_s: list[float], shown: tuple[str, str], healed: str = "") -> None:
        self.bench = cast(Bench, SimpleNamespace(now_s=1000.0, town=SimpleNamespace(moved_s=0.0)))
        self._steps_s, self._told, self._healed = steps_s, shown, healed
        self._broken = ExitStack()
        self.run(0.0)

    def run(self, duration_s: float) -> None:
        bench = cast(Any, self.bench)
        bench.now_s += duration_s
        bench.town.moved_s = max(s for s in (-1.0, *self._steps_s) if 1000.0 + s <= bench.now_s)
        bench.town.moved_s += 1000.0

    def recover(self) -> None:
        self._told = (self._healed or self._told[0], self._told[1])

    def _shown(self) -> tuple[str, str]:
        return self._told


def judged(case: Case, steps_s: list[float], state: str = "FAULT", healed: str = "") -> Outcome:
    """What comes of a case with motor steps so long [s] after the fault."""
    seen = Seen(steps_s, (state, "the newest frame is old"), healed)
    return seen._meet(case, Outcome(case.family, case.name, case.what))


def test_a_robot_must_stop_a_quarter_of_a_second_after_the_threshold() -> None:
    right = judged(FAULT, [0.1, 0.449])
    assert (right.problem, right.state) == ("", "FAULT")
    assert right.stopped_s == pytest.approx(0.449)
    assert judged(FAULT, [0.1, 0.451]).problem == "the last step came 251 ms after the threshold"
    assert judged(replace(FAULT, moving=False), []).stopped_s is None


def test_a_robot_that_stopped_must_stay_where_it_is_and_as_it_is() -> None:
    assert judged(FAULT, [0.1, 1.3]).problem == "a motor stepped 0.05 s after mending"
    for armed in ("READY", "AUTO", "MANUAL"):
        assert judged(FAULT, [0.1], healed=armed).problem == f"it is {armed} after mending"
    for stands in ("DISARMED", "HOLD", "FAULT"):
        assert judged(FAULT, [0.1], healed=stands).problem == ""


@pytest.mark.parametrize("state", ["DISARMED", "READY", "AUTO", "MANUAL", "HOLD"])
def test_another_state_or_reason_than_the_cases_is_a_problem(state: str) -> None:
    assert f"expected FAULT, shown is {state}: " in judged(FAULT, [0.1], state).problem
    assert "a reason with 'link'" in judged(replace(FAULT, says="link"), [0.1]).problem
    wrong = replace(FAULT, states=(state,))
    assert f"expected {state}, shown is FAULT" in judged(wrong, [0.1]).problem


def test_a_robot_that_must_drive_on_may_not_stand() -> None:
    case = replace(FAULT, states=())
    drives = judged(case, [0.1, 1.2], "AUTO")
    assert (drives.problem, drives.stopped_s) == ("", None)
    assert "it stands" in judged(case, [0.1, 0.9], "AUTO").problem
    assert "expected AUTO, shown is HOLD" in judged(case, [0.1, 1.2], "HOLD").problem


def test_who_may_drive_on_may_also_step_after_mending() -> None:
    assert judged(replace(FAULT, states=("AUTO",)), [0.1, 1.3], "AUTO").problem == ""


@pytest.mark.parametrize("restarted", [False, True])
def test_armed_again_the_same_process_must_drive(
    monkeypatch: pytest.MonkeyPatch, restarted: bool
) -> None:
    seen, robots = Seen([], ("AUTO", "")), [SimpleNamespace(alive=True) for _ in range(2)]
    running: Any = {"robot": robots[0]}
    monkeypatch.setattr(seen.bench, "processes", running, raising=False)
    monkeypatch.setattr(seen, "ready", lambda: running.update(robot=robots[restarted]))
    monkeypatch.setattr(seen, "drive_off", lambda: None)
    assert seen._again_problem() == ("it had to be started again" if restarted else "")


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


def test_what_the_table_calls_by_its_place_is_there() -> None:
    """A chip that lost its supply had no such method for days, and no quick test noticed."""
    table = (Path(faults.__file__).parent / "cases.yaml").read_text(encoding="utf-8")
    called = set(re.findall(r"\b(bench(?:\.[a-z_]+)*)\.([a-z_]+):", table))
    assert called >= {("bench.town.hat.chip", "power_cycle"), ("bench", "freeze")}
    assert [act for place, act in called if not callable(getattr(ACTS_ON[place], act, None))] == []
