"""What a row of sight's answer means, and what is no answer."""

from __future__ import annotations

from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest

from robot.camera.source import Frame
from robot.contract import ImageSpec
from robot.errors import ContractError
from robot.vision import sight
from robot.vision.sight import COLUMNS, Glimpse, OnnxSight, SightContract, as_seen


def answering(rows: np.ndarray, columns: Any, monkeypatch: pytest.MonkeyPatch) -> OnnxSight:
    """A sight whose file says that it has these columns, and whose network gives these rows."""

    def opened(self: Any, path: str, *_: Any) -> None:
        self.path, self.contract = path, SightContract(ImageSpec(), columns)

    monkeypatch.setattr(sight.Network, "__init__", opened)
    monkeypatch.setattr(sight.Network, "expect", lambda *_: None)
    monkeypatch.setattr(sight.Network, "answer", lambda *_: rows)
    return OnnxSight("sight.onnx")


def test_a_row_is_figures_deviations_probabilities_and_the_junction() -> None:
    seen = as_seen(np.stack((np.arange(18.0), np.arange(100.0, 118.0))))
    assert seen.figures.tolist() == [[0, 1, 2, 3, 4], [100, 101, 102, 103, 104]]
    assert seen.deviations[0].tolist() == [5, 6, 7, 8, 9]
    assert (seen.line.tolist(), seen.road.tolist()) == ([10, 110], [11, 111])
    assert seen.thing.tolist() == [12, 112]
    assert seen.junction[1].tolist() == [113, 114, 115, 116, 117]


@pytest.mark.parametrize(
    ("road", "left_m", "in_lane"),
    [(0.51, 0.0, True), (0.49, 0.0, False), (1.0, 0.169, True), (1.0, 0.171, False)],
)
def test_who_is_over_the_middle_of_the_road_sees_no_lane_of_its_own(
    road: float, left_m: float, in_lane: bool
) -> None:
    row = np.zeros((1, 18))
    row[0, COLUMNS.index("road")], row[0, COLUMNS.index("offset_m")] = road, left_m
    assert as_seen(row).in_lane.tolist() == [in_lane]


def test_a_contract_is_read_again_as_it_was_written() -> None:
    contract = SightContract(ImageSpec(), run="one", trained_steps=7)
    assert contract.schema == 1
    assert SightContract.from_json(contract.to_json()) == contract


def test_columns_in_another_order_and_answers_that_are_none_are_refused(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    pictures = np.zeros((1, 120, 160, 3), np.uint8)
    assert answering(np.zeros((1, 18)), COLUMNS, monkeypatch)(pictures).line.tolist() == [0.0]
    with pytest.raises(ContractError, match=r"expected the columns offset_m, .*train-sight"):
        answering(np.zeros((1, 18)), COLUMNS[::-1], monkeypatch)
    for wrong in (np.nan, np.inf):
        with pytest.raises(ContractError, match="expected finite figures"):
            answering(np.full((1, 18), wrong), COLUMNS, monkeypatch)(pictures)


def test_each_picture_is_looked_at_once_with_the_time_when_it_came() -> None:
    image = np.full((120, 160, 3), 7, np.uint8)
    frames = [None, Frame(image, 3, 1.5), Frame(image, 3, 1.5), Frame(image, 4, 1.6)]
    eye, newest = Mock(return_value="seen"), Mock(side_effect=frames)
    eye.contract.image = ImageSpec()
    glimpse = Glimpse(eye, newest)
    looks = [glimpse.look() for _ in frames]
    assert looks == [None, ("seen", 1.5), None, ("seen", 1.6)]
    assert eye.call_count == 2
    np.testing.assert_array_equal(eye.call_args[0][0], image[None])
