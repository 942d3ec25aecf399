"""A stage of faults: what counts as met, and what is broken and mended for it; no bench."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import astuple, replace
from types import SimpleNamespace
from typing import Any, cast

import pytest

from robot.geometry import Pose
from robot.hat.config import HatConfig
from robot.hat.driver import WAKE_S
from robot.link.messages import PosesMessage
from tools.faults import stage as the_stage
from tools.faults.case import Act, Case, Outcome, nothing
from tools.faults.stage import DRIVE_S, Stage, StandIn, _stands
from tools.loop.bench import Bench
from tools.loop.operator import Operator
from tools.loop.timekeeper import BenchError

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


def test_a_robot_that_holds_may_not_go_on_by_itself_either() -> None:
    for states in (("HOLD",), ("HOLD", "FAULT")):
        told = judged(replace(FAULT, states=states), [0.1, 1.3], "HOLD").problem
        assert told == "a motor stepped 0.05 s after mending"


def test_a_step_while_it_is_being_mended_counts_too() -> None:
    class Slow(Seen):
        def recover(self) -> None:
            self.run(0.5)

    seen = Slow([0.1, 1.3], ("FAULT", "the newest frame is old"))
    assert "0.05 s after mending" in seen._meet(FAULT, Outcome("camera", "stops", "")).problem


def test_a_fault_comes_when_a_robot_has_found_its_rotors_and_drives_at_full_speed() -> None:
    config = HatConfig()
    assert WAKE_S + config.max_speed_mps / config.acceleration_mps2 < DRIVE_S


def test_a_robot_that_must_fall_silent_is_looked_at_for_longer() -> None:
    silent = replace(FAULT, silent=True)
    assert judged(silent, [0.1], "silent").problem == ""
    assert "expected silent, shown is FAULT" in judged(silent, [0.1], "FAULT").problem
    late = judged(silent, [0.1, 1.9], "silent").problem
    assert late == "the last step came 1700 ms after the threshold"


def test_nothing_shown_is_neither_a_state_nor_a_reason() -> None:
    assert "expected FAULT, shown is : " in judged(FAULT, [0.1], "").problem
    mute = Seen([0.1], ("FAULT", ""))._meet(FAULT, Outcome("camera", "stops", ""))
    assert mute.problem == "expected a reason with 'frame', shown is ''"


class Played(Seen):
    """Notes what a case does with it, and in which order."""

    def __init__(self, again: str = "") -> None:
        super().__init__([0.1], ("FAULT", "the newest frame is old"))
        self.done: list[str] = []
        self._again = again

    def ready(self) -> None:
        self.done.append("ready")

    def drive_off(self) -> None:
        self.done.append("drive off")

    def recover(self) -> None:
        self.done.append("mend")

    def _again_problem(self) -> str:
        self.done.append("again")
        return self._again


def noting(word: str, told: str = "") -> Act:
    return lambda stage: stage.done.append(word) or told  # type: ignore[attr-defined]


PARTS = {name: noting(name) for name in ("before", "approach", "inject")}
PLAYED = replace(FAULT, **PARTS, check=(noting("look"), noting("look again")))  # type: ignore[arg-type]
LOOKED = ["inject", "look", "look again", "mend", "mend"]


def test_a_case_is_played_in_order_and_mended_in_the_end() -> None:
    for moving in (True, False):
        stage = Played()
        assert stage.play(replace(PLAYED, moving=moving)).problem == ""
        drive = ["drive off"] * moving
        assert stage.done == ["ready", "before", *drive, "approach", *LOOKED]
    drives_on, stage = replace(PLAYED, states=()), Played()
    stage.play(drives_on)
    assert "drive off" in stage.done


def test_each_look_that_tells_what_is_wrong_is_a_problem() -> None:
    case = replace(
        PLAYED, check=(noting("look", "red"), noting("look", "green")), drives_again=True
    )
    stage = Played(again="it does not drive")
    assert stage.play(case).problem == "red; green"
    assert "again" not in stage.done


def test_who_must_drive_again_is_asked_to() -> None:
    stage = Played(again="it does not drive")
    assert stage.play(replace(PLAYED, drives_again=True)).problem == "it does not drive"
    assert stage.done[-3:] == ["mend", "again", "mend"]


@pytest.mark.parametrize("error", [BenchError("no answer"), ConnectionRefusedError("no answer")])
@pytest.mark.parametrize("part", ["before", "approach", "inject"])
def test_a_case_that_could_not_be_played_is_not_met(error: Exception, part: str) -> None:
    def breaks(_: Stage) -> None:
        raise error

    stage = Played()
    assert stage.play(replace(PLAYED, **{part: breaks})).problem == "the bench: no answer"  # type: ignore[arg-type]
    assert stage.done[-1] == "mend"


def test_what_is_broken_stays_so_until_it_is_mended() -> None:
    done: list[object] = []

    @contextmanager
    def breaks(_: Stage) -> Iterator[None]:
        done.append("broken")
        yield
        done.append("mended")

    stage = Played()
    stage.bench.revive = lambda: done.append("revived")  # type: ignore[method-assign]
    stage.shared = cast(Any, SimpleNamespace(set=lambda *told: done.append(told)))
    stage.recover = lambda: Stage.recover(stage)  # type: ignore[method-assign]
    look: Act = lambda _: done.append("look")  # noqa: E731
    assert stage.play(replace(FAULT, inject=breaks, check=(look,))).problem == ""
    assert done[:5] == ["broken", "look", "mended", ("lossy", 0.0), "revived"]


def test_where_the_page_is_silent_or_gone_the_robots_terminal_tells() -> None:
    said = "READY: arm, by a person\nFAULT: the frame is old\n"

    def shown(lives: bool, watching: bool, silent: bool, said: str = said) -> tuple[str, str]:
        page = SimpleNamespace(state="AUTO", reason="auto", watching=watching)
        page.snapshot = {"silent": silent, "silence_s": 1.4}
        robot = SimpleNamespace(said=lambda: said)
        parts = {"operator": page, "page_lives": lives, "folder": "/tmp/bench"}
        bench = SimpleNamespace(processes={"robot": robot}, **parts)
        return Stage._shown(cast(Stage, SimpleNamespace(bench=bench)))

    assert shown(True, True, False) == ("AUTO", "auto")
    terminal = "at the robot's terminal FAULT: the frame is old"
    assert shown(True, True, True) == ("silent", f"silent for 1.4 s; {terminal}")
    assert shown(False, True, False) == shown(True, False, False) == ("FAULT", "the frame is old")
    assert shown(False, True, False, "Killed\n") == ("", "Killed")


def test_a_robot_that_does_not_drive_off_meets_no_fault() -> None:
    def drive_off(state: str, accepted: bool) -> None:
        page = SimpleNamespace(state=state, reason="why", ask=lambda *_: (accepted, "no"))
        bench = SimpleNamespace(operator=page, options=SimpleNamespace(leader=None))
        on = SimpleNamespace(bench=bench, goal=(1.0, 1.0), run=lambda _: None)
        Stage.drive_off(cast(Stage, on))

    drive_off("AUTO", True)
    with pytest.raises(BenchError, match="expected AUTO, got HOLD: why"):
        drive_off("HOLD", True)
    with pytest.raises(BenchError, match="expected arm to be accepted, got: no"):
        drive_off("AUTO", False)


@pytest.mark.parametrize(
    ("state", "pose", "stands"),
    [
        ("DISARMED", (1.0, 1.04, 3.1), True),
        ("DISARMED", (1.0, 1.06, 3.1), False),
        ("DISARMED", (1.0, 1.0, 0.0), False),
        ("HOLD", (1.0, 1.0, 3.1), False),
        ("DISARMED", None, False),
    ],
)
def test_a_robot_is_ready_where_it_knows_that_it_stands(
    state: str, pose: object, stands: bool
) -> None:
    page = cast(Operator, SimpleNamespace(state=state, robot={"pose": pose}))
    assert _stands(page, Pose(1.0, 1.0, -math.pi)) is stands


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
    running["robot"].alive = False
    assert seen._again_problem() == "it had to be started again"

    def refused() -> None:
        raise BenchError("no")

    monkeypatch.setattr(seen, "drive_off", refused)
    assert "it does not drive: no" in seen._again_problem()


def stand_in(monkeypatch: pytest.MonkeyPatch) -> tuple[StandIn, list[bytes], Any]:
    """One that publishes into a list, and its bench."""
    sent: list[bytes] = []
    socket = SimpleNamespace(send=sent.append)
    link = SimpleNamespace(bind=lambda *_: socket, allow_list=SimpleNamespace(admit=lambda: 0))
    monkeypatch.setattr(the_stage, "Link", lambda *_: link)
    monkeypatch.setattr(the_stage, "let_sockets_wait", lambda: None)
    bench = SimpleNamespace(now_s=50.0, town=SimpleNamespace(pose=Pose(1.0, 2.0, 0.5)))
    bench.time = SimpleNamespace(every=lambda _, tell: tell)
    bench.link_configs = {"localizer": SimpleNamespace()}
    shared = cast(Any, SimpleNamespace(set=lambda *_: None))
    return StandIn(cast(Bench, bench), shared, cast(Any, "keys")), sent, bench


def told(sent: list[bytes]) -> list[PosesMessage]:
    return [PosesMessage.from_bytes(data) for data in sent]


def test_a_stand_in_tells_the_truth_in_order_until_it_is_to_lie(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    localizer, sent, bench = stand_in(monkeypatch)
    for _ in range(2):
        localizer._tell()
    first, second = told(sent)
    assert astuple(first.robots[0])[1:4] == pytest.approx((1.0, 2.0, 0.5))
    assert (first.session, first.t_sent_s) == (second.session, second.t_sent_s)
    assert (second.sequence, first.t_sent_s) == (first.sequence + 1, 50.0)
    bench.now_s = 60.0
    localizer.lies(lambda pose, s, first: pose.moved(0.1 * s, 0.0))
    bench.now_s = 62.0
    localizer._tell()
    assert astuple(told(sent)[-1].robots[0])[1:4] == pytest.approx(
        Pose(1.0, 2.0, 0.5).moved(0.2, 0.0)
    )


def test_a_stand_in_is_late_jumps_and_contradicts_itself_when_told_to(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    localizer, sent, bench = stand_in(monkeypatch)
    localizer.twins, localizer.clock_step_s = True, -30.0
    for _ in range(2):
        localizer._tell()
    first, second = told(sent)
    assert first.session != second.session
    assert first.t_sent_s == 20.0
    localizer.backwards = True
    for _ in range(2):
        localizer._tell()
    assert told(sent)[-1].sequence == told(sent)[-2].sequence - 1
    localizer.late_s = 0.4
    localizer._tell()
    assert len(sent) == 4, "it waits"
    bench.now_s = 50.5
    localizer._tell()
    assert len(sent) == 5
    localizer.instead, localizer.late_s, bench.now_s = [b"garbage"], 0.0, 60.0
    localizer._tell()
    assert sent[5:] == [b"garbage"]
