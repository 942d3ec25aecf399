"""What a lesson makes of its pictures, and what it then still says of them."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot.navigation.road_map import load_map
from sim_pybullet.look import NOMINAL
from sim_pybullet.tasks.navigation import Navigation
from trainer.sight import augment
from trainer.sight.augment import drawn, fronted, glinting, spoiled, tinged
from trainer.sight.pictures import (
    FIGURES,
    IMAGE,
    KIND,
    LINE,
    LINE_FIGURE,
    ROAD,
    ROBOTS,
    START_SPREAD,
    THING,
    Pictures,
    drive,
)

GREY = np.full(IMAGE.shape, 120, np.uint8)


@pytest.fixture(scope="module")
def driven() -> Pictures:
    return drive(Navigation([load_map("town")], ROBOTS, START_SPREAD), [NOMINAL], 3, 40)


@given(st.integers(0, 10_000))
def test_each_change_leaves_the_road_where_it_is(seed: int) -> None:
    rng = np.random.default_rng(seed)
    image = rng.integers(0, 256, IMAGE.shape, dtype=np.uint8)
    dark = tinged(image, rng)
    assert (dark <= image).all()
    assert np.count_nonzero((dark != image).any(axis=(0, 1))) <= 1, "one colour"
    assert (glinting(image, rng) >= image).all(), "light is added"
    own = fronted(image, rng)
    assert (own[: IMAGE.shape[0] // 4] == image[: IMAGE.shape[0] // 4]).all()
    assert own.shape == image.shape
    assert own.dtype == np.uint8


def test_a_front_rises_from_below_without_a_gap() -> None:
    for seed in range(100):
        hidden = (fronted(GREY, np.random.default_rng(seed)) != GREY).any(axis=2)
        seen = np.cumsum(hidden[::-1], axis=0)[::-1]  # hidden pixels from here down
        below = np.arange(IMAGE.shape[0], 0, -1)[:, None]
        assert (seen[hidden] >= 0.8 * np.broadcast_to(below, hidden.shape)[hidden]).all()


@pytest.mark.parametrize("change", [tinged, glinting, fronted, spoiled])
def test_a_change_is_seen(
    change: Callable[[np.ndarray, np.random.Generator], np.ndarray], driven: Pictures
) -> None:
    rng = np.random.default_rng(0)
    other = [(change(image, rng) != image).any() for image in driven.images[:30]]
    assert sum(other) >= 28


def test_spoiled_pictures_of_a_lesson_say_no_road_and_nothing_else(driven: Pictures) -> None:
    images, labels = drawn(driven, 200, np.random.default_rng(0))
    none = labels[:, ROAD] == 0.0
    assert 5 < none.sum() < 60
    assert np.isnan(labels[none, :FIGURES]).all()
    assert (labels[none][:, (LINE, THING, KIND)] == -1.0).all()
    assert images.dtype == np.uint8


def test_of_a_red_line_behind_the_own_front_nothing_is_said(
    driven: Pictures, monkeypatch: pytest.MonkeyPatch
) -> None:
    only = [float(name == "_FRONTED") for name in ("_RELIT", "_TINGED", "_GLINTING", "_FRONTED")]
    for name, share in zip(("_RELIT", "_TINGED", "_GLINTING", "_FRONTED"), only, strict=True):
        monkeypatch.setattr(augment, name, share)
    monkeypatch.setattr(augment, "_SPOILED", 0.0)
    before, chosen = driven.labels[:, LINE_FIGURE], driven.labels[:, LINE] == 1.0
    assert (before[chosen] < 0.15).any()
    _, labels = drawn(driven, 400, np.random.default_rng(0))
    assert not (labels[:, LINE_FIGURE] < 0.2).any()
    assert (labels[:, LINE] == 1.0).any()
    assert np.isfinite(labels[:, 0]).mean() == pytest.approx(
        np.isfinite(driven.labels[:, 0]).mean(), abs=0.1
    )
