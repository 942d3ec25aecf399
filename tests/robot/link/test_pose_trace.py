"""The gate of poses to the figure: its constants as literals, its edges, and a long trace."""

from __future__ import annotations

import math
from typing import List, Tuple

import pytest

from robot.link import freshness
from robot.link.freshness import PoseGate, StreamGate
from robot.link.messages import PoseMessage


def pose(
    sequence: int, t_s: float, x_m: float = 0.0, y_m: float = 0.0, session: str = "a"
) -> PoseMessage:
    """Sent at ``t_s``, of a picture 20 ms older."""
    return PoseMessage("duck", x_m, y_m, 0.0, 1.0, t_s - 0.02, session, sequence, t_s)


def test_the_figures_of_the_gate() -> None:
    """A quarter more than the fastest wheel of the table, and ten centimetres."""
    from robot.contract import MAX_WHEEL_MPS

    assert pytest.approx(1.25 * MAX_WHEEL_MPS) == freshness.MAX_SPEED_MPS
    assert (freshness.MARGIN_M, freshness.MIN_CONFIDENCE) == (0.10, 0.1)
    assert (freshness.CLOCK_DRIFT, freshness.TAKEOVER_S) == (2e-4, 1.0)
    assert freshness.REMEMBERED_SESSIONS == 16


@pytest.mark.parametrize(
    ("x_m", "y_m", "taken"),
    [
        *((-1.0, 0.0, True), (2.0, 0.0, True), (0.0, -3.0, True), (0.0, 4.0, True)),
        *((-1.01, 0.0, False), (2.01, 0.0, False), (0.0, -3.01, False), (0.0, 4.01, False)),
    ],
)
def test_the_map_ends_where_its_bounds_do(x_m: float, y_m: float, taken: bool) -> None:
    gate = PoseGate("duck", (-1.0, -3.0, 2.0, 4.0))
    assert gate.take(pose(1, 0.0, x_m, y_m), 0.0) is taken
    assert gate.stream.refused == ({} if taken else {"off the map": 1})


def test_reach_is_by_the_longer_of_both_clocks_and_in_every_direction() -> None:
    reach_m = freshness.MAX_SPEED_MPS * 0.5 + 0.10
    for angle in (0.0, 1.0, 2.5, -2.0):
        for share, taken in ((0.99, True), (1.01, False)):
            x_m, y_m = share * reach_m * math.cos(angle), share * reach_m * math.sin(angle)
            gate = PoseGate("duck")
            assert gate.take(pose(1, 10.0), 0.0)
            # they arrive together, but the pictures were half a second apart
            assert gate.take(pose(2, 10.5, x_m, y_m), 0.01) is taken
            gate = PoseGate("duck")
            assert gate.take(pose(1, 10.0), 0.0)
            assert gate.take(pose(2, 10.01, x_m, y_m), 0.5) is taken, "or they arrive apart"


def test_another_session_has_another_clock() -> None:
    gate = PoseGate("duck")
    assert gate.take(pose(5, 10.0), 0.0)
    assert not gate.take(pose(1, 500.0, 0.4, session="b"), 0.1), "490 s tell nothing of the way"
    assert gate.take(pose(2, 500.1, 0.1, session="b"), 0.2)
    assert gate.latest is not None
    assert (gate.latest.session, gate.latest.x_m) == ("b", 0.1)


def test_a_reason_is_the_first_that_holds() -> None:
    gate = PoseGate("duck", (0.0, 0.0, 1.0, 1.0))
    assert gate.take(pose(3, 0.0), 0.0)
    far = PoseMessage("drake", 9.0, 9.0, 0.0, 0.01, 0.0, "a", 2, 0.1)
    for change, reason in (
        ({}, "out of order"),
        ({"sequence": 4}, "another robot"),
        ({"sequence": 5, "robot": "duck"}, "low confidence"),
        ({"sequence": 6, "robot": "duck", "confidence": 0.9}, "off the map"),
    ):
        before = gate.stream.refused.copy()
        assert not gate.take(PoseMessage(**{**vars(far), **change}), 0.1)  # type: ignore[arg-type]
        assert gate.stream.refused - before == {reason: 1}
    assert gate.latest is not None
    assert gate.latest.sequence == 3


def trace() -> Tuple[List[str], List[float]]:
    """Four hundred messages: late ones, held up ones, restarts, and two who talk at once."""
    gate, told, ages = StreamGate(), [], []
    sequences = {"a": 0, "b": 0, "c": 0}
    now_s = 100.0
    for k in range(400):
        now_s += 0.05 + (0.4 if k % 90 == 60 else 0.0)
        session = "a" if k < 150 else "b"
        if 220 <= k < 240 and k % 2:
            session = "a"  # the first one still speaks
        if k >= 330:
            session = "c" if k < 360 or k > 385 else "b"
        sequences[session] += 1 if k % 17 else -1
        late_s = 0.03 + 0.2 * (k % 40 == 7) + 0.01 * math.sin(k) ** 2 + 1e-4 * k
        sent_s = 7.0 + now_s - late_s
        reason = gate.problem(session, sequences[session], now_s)
        told.append(reason)
        if not reason:
            gate.take(sequences[session], sent_s, now_s, sent_s - 0.02 * (k % 3))
        ages.append(gate.age_s(now_s))
    return told, ages


def test_a_long_trace_is_judged_as_ever() -> None:
    told, ages = trace()
    assert {reason: told.count(reason) for reason in set(told)} == COUNTS
    assert [ages[k] for k in range(9, 400, 30)] == pytest.approx(AGES, abs=1e-6)


COUNTS = {"": 290, "out of order": 39, "two publishers": 71}
AGES = [
    0.002039,
    0.01233,
    0.1328,
    0.018345,
    0.011435,
    0.009138,
    0.005347,
    0.011959,
    1.875879,
    0.014236,
    0.021864,
    0.001463,
    0.548163,
    2.048163,
]
