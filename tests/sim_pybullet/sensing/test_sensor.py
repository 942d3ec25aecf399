import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sim_pybullet.look import SensorLook
from sim_pybullet.sensing.sensor import apply_sensor

PICTURES = np.random.default_rng(5).integers(0, 256, (3, 60, 80, 3), dtype=np.uint8)
GREY = np.full((1, 120, 160, 3), 100, np.uint8)


def through(look: SensorLook, frames: np.ndarray = GREY, seed: int = 0) -> np.ndarray:
    return apply_sensor(frames, [look] * len(frames), np.random.default_rng(seed))


def test_a_nominal_sensor_returns_the_picture_as_it_is() -> None:
    np.testing.assert_array_equal(through(SensorLook(), PICTURES), PICTURES)


@pytest.mark.parametrize(
    "look",
    [
        SensorLook(blur_px=1.5),
        SensorLook(vignetting=0.5),
        SensorLook(exposure=0.7),
        SensorLook(white_balance=(1.2, 1.0, 0.8)),
        SensorLook(noise=5.0),
        SensorLook(jpeg_quality=50),
    ],
    ids=lambda look: str(look),
)
def test_every_effect_changes_only_what_it_returns_and_repeats(look: SensorLook) -> None:
    kept = PICTURES.copy()
    first = through(look, PICTURES)
    assert np.array_equal(PICTURES, kept)
    assert not np.array_equal(first, PICTURES)
    assert not np.shares_memory(first, PICTURES)
    assert np.array_equal(first, through(look, PICTURES))


def test_each_frame_has_its_own_sensor() -> None:
    looks = [SensorLook(), SensorLook(exposure=0.5), SensorLook(blur_px=2.0, jpeg_quality=60)]
    seen = apply_sensor(PICTURES, looks, np.random.default_rng(0))
    assert np.array_equal(seen[0], PICTURES[0])
    for i, look in enumerate(looks):
        alone = apply_sensor(PICTURES[i : i + 1], [look], np.random.default_rng(0))
        assert np.array_equal(seen[i], alone[0])


@settings(max_examples=30, deadline=None)
@given(st.floats(0.3, 3.0), st.tuples(*[st.floats(0.5, 1.6)] * 3))
def test_exposure_and_white_balance_are_gains(
    exposure: float, balance: tuple[float, float, float]
) -> None:
    seen = through(SensorLook(exposure=exposure, white_balance=balance))
    expected = np.minimum(255.0, 100.0 * exposure * np.array(balance))
    assert np.abs(seen[0, 60, 80] - expected).max() <= 0.51


def test_noise_has_the_asked_spread_and_no_bias_and_differs_by_frame() -> None:
    frames = np.repeat(GREY, 4, axis=0)
    seen = through(SensorLook(noise=8.0), frames).astype(float)
    assert abs(seen.mean() - 100.0) < 0.2
    assert seen.std() == pytest.approx(8.0, rel=0.03)
    assert not np.array_equal(seen[0], seen[1])
    assert abs(np.corrcoef(seen[0, 10].ravel(), seen[0, 11].ravel())[0, 1]) < 0.2


def test_noise_of_small_pictures_is_what_averaging_leaves() -> None:
    small = through(SensorLook(noise=8.0), np.full((4, 60, 80, 3), 100, np.uint8)).astype(float)
    large = through(SensorLook(noise=8.0), np.repeat(GREY, 4, axis=0)).astype(float)
    averaged = large.reshape(4, 60, 2, 80, 2, 3).mean(axis=(2, 4))
    assert small.std() == pytest.approx(averaged.std(), rel=0.05)


def test_vignetting_darkens_corners_by_its_share_and_leaves_the_middle() -> None:
    seen = through(SensorLook(vignetting=0.4))[0]
    assert abs(int(seen[0, 0, 0]) - 60) <= 1
    assert abs(int(seen[60, 80, 0]) - 100) <= 1
    cropped = apply_sensor(
        GREY[:, 40:], [SensorLook(vignetting=0.4)], np.random.default_rng(0), crop_top_px=40
    )
    assert np.array_equal(cropped[0], seen[40:])


def test_blur_keeps_the_mean_and_spreads_a_point() -> None:
    point = np.zeros((1, 121, 160, 3), np.uint8)
    point[0, 60, 80] = 255
    seen = through(SensorLook(blur_px=1.0), point).astype(float)[0, ..., 0]
    rows, columns = np.nonzero(seen)
    assert abs(rows.mean() - 60) < 0.1
    assert abs(columns.mean() - 80) < 0.1
    assert 2 <= np.ptp(rows) <= 8
    assert seen.sum() == pytest.approx(255.0, rel=0.15)


def test_a_wrong_number_of_looks_is_refused() -> None:
    with pytest.raises(ValueError, match="shorter than"):
        apply_sensor(PICTURES, [SensorLook()], np.random.default_rng(0))
