"""Where the policy looks, worked out beside the page."""

import threading
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from robot.link.messages import FrameMessage, Telemetry
from robot.link.sockets import LinkConfig, Publisher
from tests.robot.link.conftest import until
from tools.monitor import attention
from tools.monitor.attention import Attention, AttentionThread, Explained, attention_of
from tools.monitor.monitor import Monitor

MODEL = Path("robot/models/lane_dueling.onnx")


def frame(sequence: int) -> FrameMessage:
    rng = np.random.default_rng(sequence)
    _, data = cv2.imencode(".jpg", rng.integers(0, 255, (120, 160, 3), dtype=np.uint8))
    return FrameMessage(data.tobytes(), 0.1 * sequence, "s", sequence, 0.1 * sequence)


def cells(told: Attention | None) -> np.ndarray:
    import base64

    assert told is not None
    data = np.frombuffer(base64.b64decode(told.cells), np.uint8)
    return data.reshape(told.rows, told.columns)


def test_the_newest_picture_is_explained() -> None:
    pytest.importorskip("onnx")
    thread = AttentionThread(MODEL)
    for sequence in range(30):
        thread.offer(frame(sequence))
    assert until(lambda: thread.newest is not None)
    nothing = FrameMessage(b"\xff\xd8no picture\xff\xd9", 9.0)
    grid = cells(thread.newest)
    assert grid.max() == 255
    assert grid[:3].max() == 0  # the policy does not see the top third
    assert until(lambda: thread.offer(nothing) is None and thread.newest is None)


def test_one_picture_is_explained_at_a_time() -> None:
    """A slow computer would be at it with ever more of its cores, and a STOP would wait."""
    pytest.importorskip("onnx")
    thread, going, seen = AttentionThread(MODEL), threading.Event(), []

    def slowly(picture: FrameMessage) -> None:
        seen.append(picture.sequence)
        going.wait(10.0)

    thread._explain = slowly  # type: ignore[method-assign]
    for sequence in range(5):
        thread.offer(frame(sequence))
    going.set()
    assert seen == [0]
    assert thread._working is not None
    assert thread._working.daemon, "a program that ends does not wait for it"


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("weight", [0.0, np.nan])
def test_where_nothing_is_looked_at_the_grid_is_dark(
    monkeypatch: pytest.MonkeyPatch, weight: float
) -> None:
    weights = np.full((120, 160), weight, np.float32)
    monkeypatch.setattr(attention, "weights_over", lambda *_: weights)
    explainer: Any = None
    assert not cells(attention_of(explainer, np.zeros((120, 160, 3), np.uint8))).any()


def test_the_robot_sends_none_and_the_page_gets_one(
    tmp_path: Path, configs: dict[str, LinkConfig]
) -> None:
    pytest.importorskip("onnx")
    with configs["robot"].open() as link:
        reports = Publisher(link, Telemetry)
        frames = Publisher(link, FrameMessage)
        monitor = Monitor(configs["monitor"], tmp_path, MODEL)

        def shown() -> bool:
            reports.send(Telemetry("duck", "READY"))
            frames.send(FrameMessage(frame(1).jpeg, 1.0))
            monitor.turn()
            robot = monitor.snapshot().robot
            return isinstance(robot, Explained) and robot.attention is not None

        assert until(shown)
        monitor.close()
