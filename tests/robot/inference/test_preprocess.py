from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot.contract import ImageSpec
from robot.errors import ContractError
from robot.inference.preprocess import FRAME_SHAPE, preprocess, preprocess_batch

SPECS = st.builds(
    lambda width, height, part: ImageSpec(width, height, int(part * height)),
    st.integers(1, 160),
    st.integers(2, 120),
    st.floats(0.0, 0.9),
)


def noise(seed: int, *batch: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return rng.integers(0, 256, (*batch, *FRAME_SHAPE), dtype=np.uint8)


@given(SPECS, st.integers(0, 9))
def test_picture_has_the_spec_shape_and_owns_its_memory(spec: ImageSpec, seed: int) -> None:
    frame = noise(seed)
    picture = preprocess(frame, spec)
    assert picture.shape == spec.shape
    assert picture.dtype == np.uint8
    assert picture.flags.c_contiguous
    assert not np.shares_memory(picture, frame)


@given(SPECS, st.integers(0, 3))
def test_batch_equals_one_by_one(spec: ImageSpec, count: int) -> None:
    frames = noise(1, count)
    pictures = preprocess_batch(frames, spec)
    assert pictures.shape == (count, *spec.shape)
    for frame, picture in zip(frames, pictures):
        np.testing.assert_array_equal(picture, preprocess(frame, spec))


def test_full_size_is_the_frame_itself_less_its_top_rows() -> None:
    frame = noise(2)
    np.testing.assert_array_equal(preprocess(frame, ImageSpec()), frame)
    np.testing.assert_array_equal(preprocess(frame, ImageSpec(crop_top_px=40)), frame[40:])


def test_halving_takes_the_mean_of_each_block() -> None:
    frame = noise(3)
    blocks = frame.reshape(60, 2, 80, 2, 3).astype(float).mean(axis=(1, 3))
    assert np.abs(preprocess(frame, ImageSpec(80, 60)) - blocks).max() <= 0.5


@given(SPECS, st.tuples(st.integers(0, 255), st.integers(0, 255), st.integers(0, 255)))
def test_a_plain_colour_stays_itself(spec: ImageSpec, rgb: tuple) -> None:
    frame = np.full(FRAME_SHAPE, rgb, dtype=np.uint8)
    assert (preprocess(frame, spec) == np.array(rgb, dtype=np.uint8)).all()


@pytest.mark.parametrize(
    "wrong",
    [
        np.zeros((480, 640, 3), np.uint8),
        np.zeros((120, 160), np.uint8),
        np.zeros((120, 160, 4), np.uint8),
        np.zeros(FRAME_SHAPE, np.float32),
        None,
    ],
)
def test_what_is_no_frame_is_refused_with_what_was_expected(wrong: object) -> None:
    with pytest.raises(ContractError, match=r"expected \(120, 160, 3\) uint8 RGB, got"):
        preprocess(wrong, ImageSpec())  # type: ignore[arg-type]
