"""One operator moves the robot at a time; anybody stops it."""

from __future__ import annotations

import inspect
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot.link.command_client import CommandClient
from robot.link.command_server import FORGOTTEN_S, HELD_S, CommandServer, OperatorLock
from robot.link.keys import AllowList
from robot.link.messages import KINDS
from robot.link.sockets import Publisher, Subscriber


def test_the_holder_alone_keeps_the_robot_driving() -> None:
    helm = OperatorLock()
    helm.heard("ann", 10.0)
    helm.done("ann", "arm", 10.0)
    helm.heard("ben", 10.9)
    assert helm.age_s(10.9) == pytest.approx(0.9)  # Ben watches, but Ann drives
    assert "another operator" in helm.problem("ben", "mission", 10.9)
    assert helm.problem("ben", "stop", 10.9) == ""
    helm.heard("ben", 12.1)
    assert helm.problem("ben", "arm", 12.1) == ""  # Ann is gone
    assert helm.age_s(12.1) == 0.0
    helm.done("ben", "arm", 12.1)
    assert "another operator" in helm.problem("ann", "arm", 12.2)


def test_beside_the_holder_others_may_watch_plan_clear_and_stop_and_nothing_else() -> None:
    helm = OperatorLock()
    helm.heard("ann", 10.0)
    helm.done("ann", "arm", 10.0)
    may = {kind for kind in KINDS if not helm.problem("ben", kind, 10.1)}
    assert may == {"beat", "stop", "disarm", "clear", "plan"}


def test_ages_are_by_a_clock_that_nobody_sets() -> None:
    for timed in (CommandServer, CommandClient, Publisher, Subscriber, AllowList):
        assert inspect.signature(timed.__init__).parameters["clock"].default is time.monotonic


@given(
    st.lists(
        st.tuples(st.sampled_from("abc"), st.sampled_from(KINDS), st.floats(0.0, 0.8)), max_size=60
    )
)
def test_two_never_move_it_within_a_second_without_a_stop(events: list) -> None:
    helm, now_s, mover, moved_s = OperatorLock(), 0.0, "", -10.0
    for sender, kind, pause_s in events:
        now_s += pause_s
        helm.heard(sender, now_s)
        problem = helm.problem(sender, kind, now_s)
        assert not (kind in ("stop", "disarm") and problem)
        if problem:
            assert sender != mover
            continue
        helm.done(sender, kind, now_s)
        if kind in ("arm", "auto", "mission", "manual"):
            assert sender == mover or now_s - moved_s > HELD_S
            mover, moved_s = sender, now_s
        elif kind in ("stop", "disarm"):
            mover, moved_s = "", -10.0
        assert 0.0 <= helm.age_s(now_s) <= FORGOTTEN_S
