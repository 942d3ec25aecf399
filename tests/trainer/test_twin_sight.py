"""Sight learns on: what recorded pictures are said to show, and who errs more."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from robot.navigation.lane_view import LaneView
from robot.navigation.road_map import load_map
from robot.recording.topics import Turn
from robot.vision.sight import OnnxSight
from trainer.cli import main
from trainer.division import division
from trainer.sight.cli import SHIPPED, SightRun
from trainer.sight.network import learned
from trainer.sight.pictures import FIGURES, FREE, ROAD, THING, label
from trainer.twin import cli, sight
from trainer.twin.fit import Twin
from trainer.twin.recorded import Recorded
from trainer.twin.sight import errors, recorded, teach_sight
from trainer.twin.teach import base_file, is_sight

LOOP = load_map("loop")
COUNT = 60


def poses_along() -> np.ndarray:
    """(N, 3) along a straight lane, 8 mm in a tenth of a second, weaving, through heading pi."""
    west = [lane for lane in LOOP.lanes if np.ptp(lane.control_points_m[:, 1]) < 1e-6]
    lane = min(west, key=lambda lane: float(np.diff(lane.control_points_m[[0, 3], 0])[0]))
    a, b = lane.control_points_m[0], lane.control_points_m[3]
    ahead = (b - a) / np.hypot(*(b - a))
    way_m = 0.03 * np.arange(COUNT)[:, None] / 4.0
    heading = np.arctan2(ahead[1], ahead[0]) + 0.3 * np.sin(0.5 * np.arange(COUNT))
    return np.column_stack((a + way_m * ahead, (heading + np.pi) % (2.0 * np.pi) - np.pi))


def driven(poses: np.ndarray) -> Recorded:
    turns = tuple(Turn(k, 0.1 * k, 0.01, 0.0, "MANUAL", "", "", (0.3, 0.3)) for k in range(COUNT))
    images = np.arange(COUNT, dtype=np.uint8)[:, None, None, None] * np.ones((120, 160, 3), "u1")
    told = np.column_stack((0.1 * np.arange(COUNT), poses))
    times_s = 0.1 * np.arange(COUNT)
    return Recorded("loop", np.zeros((0, 2)), times_s, images, told, told, 0.0, turns)


def twin_of(poses: np.ndarray, late_s: float | None) -> Twin:
    found = {} if late_s is None else {"timing.camera_delay_s": (late_s, 0.01)}
    nothing: Any = None
    return Twin(found, (), nothing, nothing, (poses,))


@pytest.mark.parametrize("late_s", [None, 0.0, 0.2, 0.05])
def test_a_picture_shows_what_the_map_has_where_it_was_taken(late_s: float | None) -> None:
    poses, view = poses_along(), LaneView(LOOP)
    twin, drive = twin_of(poses, late_s), driven(poses)
    parts = [recorded([drive], twin, held_out) for held_out in (False, True)]
    assert [len(part.labels) for part in parts] == [42, 18], "the last three tenths are held out"
    images = np.concatenate([part.images for part in parts])
    assert images[:, 0, 0, 0].tolist() == list(range(COUNT)), "none twice"
    found = np.concatenate([part.labels for part in parts])
    assert np.abs(np.diff(poses[:, 2])).max() > 6.0
    turned = np.unwrap(poses[:, 2])
    for k in range(2, COUNT):
        i, j = {None: (k, k), 0.0: (k, k), 0.2: (k - 2, k - 2), 0.05: (k - 1, k)}[late_s]
        x, y = 0.5 * (poses[i, :2] + poses[j, :2])
        there = label(view, (x, y, 0.5 * (turned[i] + turned[j])))
        np.testing.assert_allclose(found[k, :3], there[:3], atol=1e-5)
        assert found[k, ROAD] == there[ROAD]
    assert np.isnan(found[:, FREE]).all()
    assert (found[:, THING] == -1.0).all(), "who stood there nobody knows"


def test_errors_are_those_in_lanes() -> None:
    poses = poses_along()
    pictures = recorded([driven(poses)], twin_of(poses, 0.0), held_out=False)
    pictures.labels[::2, 0] = 0.25  # in the oncoming lane, where nobody is asked

    def seen(images: np.ndarray) -> Any:
        figures = np.nan_to_num(pictures.labels[:, :FIGURES].copy())
        figures[::2, :2] += 9.0
        figures[1::2, :2] += np.array((0.03, 0.2)) * (1.0 - 2.0 * (np.arange(21) % 2))[:, None]
        return OnnxSight(SHIPPED)(images)._replace(figures=figures)

    told: Any = seen
    found = errors(told, pictures)
    assert found.tolist() == pytest.approx([0.03, 0.2], rel=1e-3)


def test_what_is_a_sight_is_known() -> None:
    assert is_sight(base_file("sight"))
    assert not is_sight(base_file("nav_ppo"))
    assert not is_sight(Path("none.onnx"))


def test_it_learns_on_and_leaves_a_sight(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sight, "DECISIONS", 3)
    monkeypatch.setattr(sight, "CHECKED", 3)
    few = replace(division(), maps=replace(division().maps, training=("loop", "hamlet")))
    monkeypatch.setattr(sight, "division", lambda: few)
    poses, run = poses_along(), SightRun(steps=2, batch=8, seed=3, base=str(SHIPPED))
    drives, twin = [driven(poses)], twin_of(poses, None)
    network = learned(SHIPPED)
    bias = network.head.bias
    wrong = bias.detach() + 2.0  # where a network would begin that had gone far astray
    bias.data = wrong.clone()
    found = teach_sight(network, drives, twin, run, tmp_path)
    before, left = (learned(each).head.bias for each in (SHIPPED, tmp_path / "sight.onnx"))
    assert torch.allclose(left, 0.5 * (before + wrong), atol=0.01), "half-way back"
    taught, base = OnnxSight(tmp_path / "sight.onnx"), OnnxSight(SHIPPED)
    assert taught.contract.trained_steps == base.contract.trained_steps + 2
    assert taught.contract.run == tmp_path.name
    held_out = recorded(drives, twin, held_out=True)
    np.testing.assert_array_equal(found, [errors(one, held_out) for one in (base, taught)])
    assert (found[0] != found[1]).all()


def test_a_sight_in_int8_is_refused_before_anything_is_read(tmp_path: Path) -> None:
    assert main(["teach", "none.mcap", "--base", "sight_int8", "--out", str(tmp_path / "a")]) == 2
    assert not (tmp_path / "a").exists()


@pytest.mark.parametrize(
    ("after", "status", "said"),
    [
        ((0.018, 0.089), 0, "1.8 cm"),
        ((0.018, 0.091), 1, "keep that"),
        ((0.01, np.nan), 1, "keep that"),  # no lane was seen
    ],
)
def test_who_sees_a_tenth_better_is_worth_it(
    after: tuple[float, float],
    status: int,
    said: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(cli, "_fit", lambda *_: ([], None))
    monkeypatch.setattr(sight, "teach_sight", lambda *_: np.array(((0.02, 0.1), after)))
    assert main(["teach", "own.mcap", "--base", "sight"]) == status
    told = capsys.readouterr().out
    assert said in told
    assert ("keep that" in told) == bool(status)
