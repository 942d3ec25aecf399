"""Age, order and plausibility, with a clock of our own."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot.link.freshness import PoseGate, StreamGate
from robot.link.messages import PoseMessage

CLOCK_DRIFT, TAKEOVER_S = 2e-4, 1.0
V_MAX_MPS, MARGIN_M = 0.432374, 0.10  # a quarter more than the fastest wheel; glitches
SENDER_AHEAD_S = 5000.0  # the sender's clock says something else altogether


def offer(gate: StreamGate, session: str, sequence: int, now_s: float, late_s: float = 0.0) -> bool:
    reason = gate.problem(session, sequence, now_s)
    if reason:
        gate.refused[reason] += 1
        return False
    gate.take(sequence, SENDER_AHEAD_S + now_s - late_s, now_s)
    return True


def pose(
    sequence: int, t_s: float, x_m: float = 0.0, session: str = "a", robot: str = "duck"
) -> PoseMessage:
    t_s += SENDER_AHEAD_S
    return PoseMessage(robot, x_m, 0.0, 0.0, 1.0, t_s - 0.02, session, sequence, t_s)


def test_nothing_heard_is_infinitely_old() -> None:
    assert StreamGate().age_s(100.0) == math.inf
    assert PoseGate("duck").stream.age_s(100.0) == math.inf


@given(st.lists(st.integers(0, 50), min_size=1, max_size=60))
def test_taken_sequences_strictly_increase(sequences: list[int]) -> None:
    gate = StreamGate()
    taken = [n for i, n in enumerate(sequences) if offer(gate, "a", n, now_s=0.1 * i)]
    assert taken == sorted(set(taken))
    assert gate.refused["out of order"] == len(sequences) - len(taken)


def test_age_grows_in_silence_whatever_the_senders_clock_says() -> None:
    gate = StreamGate()
    for i in range(10):
        assert offer(gate, "a", i, now_s=0.1 * i)
    assert gate.age_s(0.9) == pytest.approx(0.0, abs=1e-9)
    assert gate.age_s(3.9) == pytest.approx(3.0, abs=1e-9)


def test_a_backlog_does_not_look_fresh() -> None:
    """What waited 2 s in a network buffer is 2 s old on arrival."""
    gate = StreamGate()
    offer(gate, "a", 1, now_s=1.0)
    offer(gate, "a", 2, now_s=4.0, late_s=2.0)
    assert gate.age_s(4.0) == pytest.approx(2.0, abs=0.01)
    offer(gate, "a", 3, now_s=4.1)
    assert gate.age_s(4.1) == pytest.approx(0.0, abs=0.01)


def test_clocks_that_drift_apart_stay_fresh() -> None:
    gate = StreamGate()
    for i in range(3600):
        offer(gate, "a", i, now_s=float(i), late_s=0.5 * CLOCK_DRIFT * i)
    assert gate.age_s(3599.0) < 0.01


def test_age_includes_the_time_from_capture_to_sending() -> None:
    gate = PoseGate("duck")
    assert gate.take(pose(1, t_s=1.0), now_s=1.0)
    assert gate.stream.age_s(1.0) == pytest.approx(0.02)


def test_a_restart_is_taken_at_once() -> None:
    gate = StreamGate()
    assert offer(gate, "a", 900, now_s=0.0)
    assert offer(gate, "b", 1, now_s=0.1)
    assert not gate.conflict(0.1)


def test_two_publishers_are_found_and_neither_is_believed() -> None:
    gate = StreamGate()
    results = [offer(gate, "ab"[i % 2], i, now_s=0.05 * i) for i in range(40)]
    assert results[:2] == [True, True]
    assert not any(results[2:])
    assert gate.conflict(1.95)
    assert gate.age_s(1.95) > 1.8
    alone = [offer(gate, "b", 100 + i, now_s=2.0 + 0.05 * i) for i in range(40)]
    first = alone.index(True)
    assert 0.9 * TAKEOVER_S <= 0.05 * first <= 1.1 * TAKEOVER_S
    assert all(alone[first:])


def test_no_pose_is_taken_of_two_who_publish_at_once() -> None:
    gate = PoseGate("duck")
    assert gate.take(pose(1, 0.0), now_s=0.0)
    assert gate.take(pose(1, 0.1, session="b"), now_s=0.1)
    for i, session in enumerate("abab"):
        now_s = 0.2 + 0.1 * i
        assert not gate.take(pose(2 + i, now_s, session=session), now_s=now_s)
    assert gate.stream.refused == {"two publishers": 4}
    assert gate.latest is not None
    assert (gate.latest.session, gate.latest.sequence) == ("b", 1)


def test_an_earlier_session_may_come_back_after_silence() -> None:
    gate = StreamGate()
    offer(gate, "a", 1, now_s=0.0)
    offer(gate, "b", 1, now_s=0.1)
    assert offer(gate, "a", 2, now_s=0.2 + TAKEOVER_S)


@pytest.mark.parametrize(
    ("message", "reason"),
    [
        (pose(2, 0.1, x_m=3.0), "jump"),
        (pose(1, 0.1), "out of order"),
        (pose(2, 0.1, robot="drake"), "another robot"),
        (pose(2, 0.1, x_m=-0.05), "off the map"),
        (PoseMessage("duck", 0.0, 0.0, None, 0.01, 0.0, "a", 2, 0.1), "low confidence"),
    ],
)
def test_impossible_poses_are_refused_and_counted(message: PoseMessage, reason: str) -> None:
    gate = PoseGate("duck", (-0.01, -1.0, 4.0, 4.0))
    assert gate.take(pose(1, 0.0), now_s=0.0)
    assert not gate.take(message, now_s=0.1)
    assert gate.stream.refused[reason] == 1
    assert gate.latest is not None
    assert gate.latest.sequence == 1
    assert gate.stream.age_s(0.1) == pytest.approx(0.12)


@given(st.floats(0.02, 1.0), st.floats(0.0, 1.0))
def test_every_pose_within_reach_is_taken(dt_s: float, share: float) -> None:
    gate = PoseGate("duck")
    gate.take(pose(1, 0.0), now_s=0.0)
    step_m = share * (V_MAX_MPS * dt_s + MARGIN_M)
    assert gate.take(pose(2, dt_s, x_m=step_m), now_s=dt_s)
    assert not gate.take(
        pose(3, 2 * dt_s, x_m=step_m + V_MAX_MPS * dt_s + MARGIN_M + 0.01),
        now_s=2 * dt_s,
    )


@pytest.mark.parametrize("session", ["a", "b"], ids=["same", "restarted"])
def test_a_robot_carried_elsewhere_is_believed_when_it_could_be_there(session: str) -> None:
    gate = PoseGate("duck")
    gate.take(pose(0, 0.0), now_s=0.0)
    first: float | None = None
    for i in range(1, 100):
        if gate.take(pose(i, 0.1 * i, x_m=2.0, session=session), now_s=0.1 * i):
            first = 0.1 * i
            break
        assert gate.stream.age_s(0.1 * i) >= 0.1 * i
    assert first is not None
    assert first == pytest.approx((2.0 - MARGIN_M) / V_MAX_MPS, abs=0.11)


def test_clocks_that_drift_apart_faster_are_a_growing_delay() -> None:
    gate = StreamGate()
    for i in range(3600):
        offer(gate, "a", i, now_s=float(i), late_s=3.0 * CLOCK_DRIFT * i)
    assert gate.age_s(3599.0) == pytest.approx(2.0 * CLOCK_DRIFT * 3599.0, rel=0.01)


def test_poses_below_a_tenth_of_confidence_are_refused() -> None:
    for confidence, taken in ((0.099, False), (0.101, True)):
        message = PoseMessage("duck", 0.0, 0.0, None, confidence, 0.0, "a", 1, 0.0)
        assert PoseGate("duck").take(message, 0.0) is taken


def test_sixteen_sessions_are_remembered() -> None:
    """One that speaks again while a younger one lives is a second publisher."""
    for others, remembered in ((15, True), (17, False)):
        gate = StreamGate()
        assert offer(gate, "first", 1, now_s=0.0)
        for i in range(others):
            assert offer(gate, f"other {i}", 1, now_s=0.01 * (i + 1))
        offer(gate, "first", 2, now_s=0.01 * (others + 1))
        assert gate.conflict(0.01 * (others + 1)) is remembered


def test_a_capture_after_its_sending_makes_no_pose_younger() -> None:
    gate = StreamGate()
    assert gate.problem("a", 1, 5.0) == ""
    gate.take(1, 100.0, 5.0, t_capture_s=160.0)
    assert gate.age_s(5.0) == pytest.approx(0.0)
    assert gate.age_s(5.5) == pytest.approx(0.5)
