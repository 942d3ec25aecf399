"""Distances, scores and the loss of lines against the slow and plain way to say them."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from trainer.transfer.cyclegan import structure
from trainer.transfer.judge import bright_lines, colour_distance, overlap
from trainer.transfer.labelled import CAMVID, ROAD, TRACK
from trainer.transfer.parser import score_classes


def test_colours_are_as_far_apart_as_the_farthest_walk() -> None:
    """Sorted against sorted: where pixels lie does not count, how many have a colour does."""
    rng = np.random.default_rng(0)
    one, other = (rng.integers(0, 256, (3, 10, 20, 3), dtype=np.uint8) for _ in range(2))
    mixed = rng.permutation(one.reshape(-1, 3)).reshape(one.shape)
    assert colour_distance(one, mixed) == 0.0
    walk = np.abs(np.sort(one.reshape(-1, 3), 0) - np.sort(other.reshape(-1, 3), 0).astype(int))
    assert colour_distance(one, other) == pytest.approx(walk.mean(), abs=0.2)
    dark, red = np.zeros((4, 6, 8, 3), np.uint8), np.zeros((1, 6, 8, 3), np.uint8)
    red[..., 0] = 30
    assert colour_distance(dark, red) == pytest.approx(10.0)


def test_overlap_is_of_all_lines_whatever_their_colour() -> None:
    found, expected = np.array([[0, 1, 2, 0]]), np.array([[0, 2, 0, 1]])
    assert overlap(found, expected) == pytest.approx(1.0 / 3.0)
    assert overlap(found * 0, found * 0) == 1.0
    assert overlap(found * 0, found) == 0.0


def test_the_scores_of_classes() -> None:
    """Six of eight, three of four, and a pixel that nobody labelled."""
    truth = np.array([0] * 8 + [1] * 4 + [255], np.uint8)
    guess = np.array([0] * 6 + [1] * 2 + [0] + [1] * 3 + [5], np.uint8)
    found = score_classes(truth[None], guess[None], ROAD, "here")
    assert (found.source, found.frames) == ("here", 1)
    assert found.pixel_accuracy == pytest.approx(9 / 12)
    assert found.class_accuracy == pytest.approx((6 / 8 + 3 / 4) / 2)
    assert found.mean_iou == pytest.approx((6 / 9 + 3 / 6) / 2)
    first, second, third = found.classes[:3]
    assert (first.name, second.name, third.name) == ("background", "road", "white_line")
    assert (first.pixels, first.accuracy, first.iou) == pytest.approx((8 / 12, 6 / 8, 6 / 9))
    assert (second.pixels, second.accuracy, second.iou) == pytest.approx((4 / 12, 3 / 4, 3 / 6))
    assert third.pixels == 0.0
    assert math.isnan(third.accuracy)
    assert math.isnan(third.iou)


def lit(dark: int, bright: int) -> tuple[np.ndarray, np.ndarray]:
    """A picture (1, 6, 8, 3) with two bright columns of eight, and its paint (1, 4, 6, 8)."""
    picture = np.full((1, 6, 8, 3), dark, np.uint8)
    picture[:, :, 2:4, :2], picture[..., 2] = bright, 255  # blue says nothing
    paint = np.zeros((1, 4, 6, 8), np.uint8)
    paint[:, 3] = 255
    paint[:, 3, :, 2:4] = 0
    paint[:, 0, :, 2], paint[:, 1, :, 3] = 255, 255
    return picture, paint


@pytest.mark.parametrize(("bright", "found"), [(126, True), (124, False)])
def test_bright_paint_is_twenty_five_levels_above_the_road(bright: int, found: bool) -> None:
    picture, paint = lit(100, bright)
    mask = bright_lines(picture, paint)
    assert mask.dtype == np.uint8
    assert mask[0, :, 2:4].all() == found
    assert not mask[0, :, :2].any()
    assert not mask[0, :, 4:].any()


@pytest.mark.parametrize(("share", "looked_at"), [(250, True), (249, False)])
def test_lines_are_looked_for_where_all_but_a_fiftieth_is_floor(
    share: int, looked_at: bool
) -> None:
    picture, paint = lit(50, 200)
    paint[:, 1, :, 3] = share
    assert bool(bright_lines(picture, paint)[0, :, 3].any()) is looked_at
    paint[:] = 0
    assert not bright_lines(picture, paint).any()


def windowed(values: np.ndarray) -> np.ndarray:
    """(H - 6, W - 6, 49) windows of 7 by 7."""
    found = np.lib.stride_tricks.sliding_window_view(values, (7, 7))
    return found.reshape(*found.shape[:2], 49)


def unlike(seen: np.ndarray, template: np.ndarray) -> float:
    """Window by window: the deviation of the template, times one minus the correlation."""
    total = weights = 0.0
    for a, b in zip(
        windowed(seen).reshape(-1, 49), windowed(template).reshape(-1, 49), strict=True
    ):
        if b.var() <= 1e-3:
            continue
        likeness = np.mean((a - a.mean()) * (b - b.mean())) / math.sqrt(
            (a.var() + 1e-4) * (b.var() + 1e-4)
        )
        total += b.std() * (1.0 - likeness)
        weights += b.std()
    return total / max(weights, 1.0)


def test_the_loss_of_lines_window_by_window() -> None:
    rng = np.random.default_rng(0)
    picture = rng.uniform(-1.0, 1.0, (3, 18, 30))
    paint = np.zeros((4, 18, 30))
    paint[0, :, 4:7], paint[1, :, 12:14], paint[2, :, 16:17] = 1.0, 1.0, 1.0
    paint[3] = 1.0 - paint[:3].sum(0)
    picture[:, :, 18:] *= 0.5  # bare road: some of its contrasts are those of a line
    brightness, yellowness = picture.mean(0), 0.5 * (picture[0] + picture[1]) - picture[2]
    expected = unlike(brightness, paint[0] + 0.8 * paint[1]) + unlike(yellowness, paint[1])
    bare = windowed(paint[3]).mean(-1) > 0.99
    contrast = np.sqrt(windowed(brightness).var(-1) + 1e-4)
    excess = np.maximum(contrast - 0.2, 0.0)[bare]
    assert 0.0 < (excess > 0.0).mean() < 1.0
    expected += excess.sum() / max(bare.sum(), 1.0)
    given = (torch.from_numpy(each).float()[None] for each in (picture, paint))
    assert float(structure(*given)) == pytest.approx(expected, rel=1e-3)


def test_every_class_of_the_simulator_has_its_place_in_each_set_of_labels() -> None:
    names = [[labels.classes[k] for k in labels.of_simulator] for labels in (CAMVID, ROAD, TRACK)]
    assert {each[0] for each in names} == {"sky", "background"}
    assert all(len(each) == 12 for each in names)
    assert all(len(set(labels.colours)) == len(labels.classes) for labels in (CAMVID, ROAD, TRACK))
    for labels in (ROAD, TRACK):  # a pixel half painted is still read as what it is
        half = [tuple(c // 2 + 40 for c in colour) for colour in labels.colours]
        assert labels.read(np.array(labels.colours, np.uint8)).tolist() == list(
            range(len(labels.classes))
        )
        assert len(half) == len(labels.classes)
    painted = ROAD.paint(np.array([1, 255], np.uint8))
    assert painted.tolist() == [[70, 70, 70], [0, 0, 0]]
