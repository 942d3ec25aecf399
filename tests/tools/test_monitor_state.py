"""What the monitor shows and logs, with clocks of our own."""

import math
from dataclasses import replace

import pytest

from robot.link.messages import Ack, FrameMessage, MissionStatus, PosesMessage, Sighting, Telemetry
from tools.monitor.monitor import SILENT_S, MonitorState, Snapshot


class World:
    """A monitor and the messages that reach it."""

    def __init__(self) -> None:
        self.now_s = 50.0
        self.state = MonitorState(lambda: self.now_s, lambda: 1e9 + self.now_s)
        self.sequence = 0

    def report(self, state: str = "READY", session: str = "run1", **fields: object) -> bool:
        self.sequence += 1
        stamp = {"session": session, "sequence": self.sequence, "t_sent_s": self.now_s}
        return self.state.take_telemetry(Telemetry("duck", state, **stamp, **fields))  # type: ignore[arg-type]

    def later(self, seconds: float) -> Snapshot:
        self.now_s += seconds
        return self.state.snapshot(answers_age_s=0.0)

    def texts(self) -> list[str]:
        return [entry.text for entry in self.state.log_after(0)]


def heard(snapshot: Snapshot) -> dict[str, float | None]:
    return {age.name: age.age_s for age in snapshot.heard}


def test_a_monitor_that_never_heard_a_robot_says_so() -> None:
    world = World()
    snapshot = world.later(10.0)
    assert snapshot.silent
    assert snapshot.silence_s is None
    assert snapshot.robot is None
    assert heard(snapshot)["telemetry"] is None
    assert world.texts() == [], "it did not fall silent"


def test_silence_is_noticed_after_a_second_and_logged_once() -> None:
    world = World()
    world.report("AUTO")
    assert not world.later(0.9 * SILENT_S).silent
    for _ in range(5):
        snapshot = world.later(1.0)
        assert snapshot.silent
    assert snapshot.silence_s == pytest.approx(5.0 + 0.9 * SILENT_S)
    assert world.texts().count("the robot is silent; last heard in AUTO") == 1
    world.report("HOLD")
    assert not world.later(0.1).silent


def test_the_limits_of_silence_are_told_to_the_figure() -> None:
    world = World()
    world.report("AUTO")
    assert not world.later(1.0).silent
    snapshot = world.later(0.01)
    assert snapshot.silent
    assert {age.name: age.limit_s for age in snapshot.heard} == {
        "telemetry": 1.0,
        "picture": 0.5,
        "localizer": 0.5,
        "answers": 1.0,
    }


@pytest.mark.parametrize(("age_s", "told_s"), [(0.2, 0.2), (1.7, 1.7), (math.inf, None)])
def test_a_robot_that_reports_but_answers_nobody_is_told(age_s: float, told_s: object) -> None:
    world = World()
    world.report("AUTO")
    assert heard(world.state.snapshot(age_s))["answers"] == told_s


def test_the_next_mission_is_logged_though_it_is_driven_as_well() -> None:
    world = World()
    for mission in ("m1", "m2"):
        world.report("AUTO", mission=MissionStatus(mission, (1.0, 2.0), remaining_m=3.0))
    assert world.texts()[1:] == ["mission to (1.00, 2.00) m: 3.0 m to drive"] * 2


def test_old_and_doubled_reports_are_not_shown() -> None:
    world = World()
    world.report("READY")
    world.sequence = 0
    assert not world.report("AUTO")
    assert world.state.telemetry is not None
    assert world.state.telemetry.state == "READY"
    for _ in range(3):
        world.sequence = 0
        assert not world.report("AUTO")
    assert world.texts().count("telemetry: out of order") == 1


def test_changes_of_state_and_mission_are_logged_once_each() -> None:
    world = World()
    mission = MissionStatus("m1", (1.0, 2.0), remaining_m=3.0)
    for state, phase in (("AUTO", "driving"), ("AUTO", "driving"), ("HOLD", "arrived")):
        world.report(state, reason="because", mission=replace(mission, phase=phase))
    assert world.texts() == [
        "AUTO: because",
        "mission to (1.00, 2.00) m: 3.0 m to drive",
        "HOLD: because",
        "mission to (1.00, 2.00) m arrived",
    ]


def test_the_log_is_numbered_so_that_nothing_is_shown_twice() -> None:
    world = World()
    world.report("READY")
    seen = world.state.log_after(0)[-1].number
    assert world.state.log_after(seen) == ()
    world.state.note_answer("arm", Ack("1", False, "no pose"))
    (entry,) = world.state.log_after(seen)
    assert (entry.number, entry.level, entry.text) == (seen + 1, "refused", "arm: no pose")


def test_the_log_keeps_200_lines_and_goes_on_to_number_them() -> None:
    state = World().state
    for number in range(1, 351):
        state.note("info", str(number))
    entries = state.log_after(0)
    assert [entry.number for entry in entries] == list(range(151, 351))
    assert [entry.text for entry in entries] == [str(entry.number) for entry in entries]


def test_a_localizer_that_sees_other_robots_only_is_none_of_this_one() -> None:
    world = World()
    daisy = Sighting("daisy", 1.0, 2.0, None, 0.5)
    assert not world.state.take_poses(PosesMessage((daisy,), 9.0, "cam", 1, 9.0))
    world.report()
    assert not world.state.take_poses(PosesMessage((daisy,), 9.0, "cam", 2, 9.0))
    snapshot = world.later(0.1)
    assert snapshot.overhead is None
    assert heard(snapshot)["localizer"] is None


def test_every_stream_ages_by_itself() -> None:
    world = World()
    world.report()
    poses = PosesMessage((Sighting("duck", 1.0, 2.0, None, 0.5),), 9.0, "cam", 1, 9.0)
    frame = FrameMessage(b"\xff\xd8\xff\xd9", 9.0, "eye", 7, 9.0)
    world.later(0.2)
    assert world.state.take_poses(poses)
    world.later(0.1)
    assert world.state.take_frame(frame)
    snapshot = world.later(0.1)
    assert heard(snapshot) == pytest.approx(
        {"telemetry": 0.4, "picture": 0.1, "localizer": 0.2, "answers": 0.0}
    )
    assert world.state.frame is not None
    assert world.state.frame.sequence == 7
    assert snapshot.overhead is not None
    assert (snapshot.overhead.x_m, snapshot.overhead.heading_rad) == (1.0, None)
