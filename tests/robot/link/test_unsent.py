"""What nobody has stamped yet, numbers of numpy on the wire, and which points of a path stay."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from robot.link.messages import (
    Ack,
    Command,
    FrameMessage,
    InputAge,
    MissionStatus,
    PoseMessage,
    PosesMessage,
    Reading,
    Telemetry,
    thin_path,
)
from robot.link.wire import plain

JPEG = b"\xff\xd8\xff\xd9"


@pytest.mark.parametrize(
    "message",
    [
        PoseMessage("d", 0.0, 0.0, 0.0, 1.0, 5.0),
        PosesMessage((), 5.0),
        FrameMessage(JPEG, 5.0),
        Telemetry("d", "READY"),
    ],
)
def test_a_message_that_no_publisher_stamped_says_so(message: Any) -> None:
    assert (message.session, message.sequence, message.t_sent_s) == ("unsent", 0, 0.0)


@pytest.mark.parametrize("message", [Command("i", "s", "arm"), Ack("i", True)])
def test_who_never_heard_the_robot_echoes_nothing(message: Any) -> None:
    assert (message.robot_session, message.robot_time_s) == ("unsent", 0.0)


def test_what_a_report_does_not_say() -> None:
    report = Telemetry("d", "READY")
    assert (report.reason, report.action, report.values, report.pose) == ("", None, (), None)
    assert (report.path, report.mission, report.inputs, report.health) == ((), None, (), ())
    assert (report.fps, report.lag_s, report.model, report.map) == (0.0, 0.0, "", "")
    mission = MissionStatus("m", (0.0, 0.0))
    assert (mission.phase, mission.reason) == ("driving", "")
    assert (mission.progress, mission.remaining_m, mission.offset_m) == (0.0, 0.0, 0.0)
    assert (Reading("r", 1.0).unit, Reading("r", 1.0).level) == ("", "ok")
    with pytest.raises(TypeError):
        InputAge("camera", 0.0)  # type: ignore[call-arg]


def test_numbers_of_numpy_are_numbers_on_the_wire() -> None:
    assert plain(np.float32(0.25)) == 0.25
    assert type(plain(np.float64(0.1234567))) is float
    assert plain(np.float64(0.1234567)) == 0.123457
    assert type(plain(np.int64(7))) is int


@pytest.mark.parametrize("axis", [0, 1])
def test_a_straight_path_is_thinned_evenly(axis: int) -> None:
    line = np.zeros((951, 2))
    line[:, axis] = np.linspace(0.0, 9.5, 951)
    thin = np.array(thin_path(line))
    assert len(thin) == 96
    np.testing.assert_allclose(np.diff(thin[:, axis]), 0.1, atol=0.011)


def test_a_radian_of_bend_has_as_many_points_as_forty_centimetres() -> None:
    """4 m of straight road and a half turn: 4 / (4 + 0.1 pi + 0.4 pi) of the points."""
    straight = np.stack((np.linspace(-4.0, 0.0, 801), np.zeros(801)), axis=1)
    turn = np.linspace(0.0, np.pi, 201)[1:]
    bend = 0.1 * np.stack((np.sin(turn), 1.0 - np.cos(turn)), axis=1)
    thin = np.array(thin_path(np.concatenate((straight, bend))))
    in_bend = np.count_nonzero((thin[:, 0] > 0.0) | (thin[:, 1] > 0.1))
    assert in_bend == pytest.approx(95 * 0.5 * np.pi / (4.0 + 0.5 * np.pi), abs=2)
    heading = np.arctan2(*np.diff(thin[thin[:, 1] > 1e-3], axis=0).T[::-1])
    turned = np.abs(np.diff(np.unwrap(heading)))
    assert turned.max() < 3.0 * turned.mean(), "evenly there, too"
