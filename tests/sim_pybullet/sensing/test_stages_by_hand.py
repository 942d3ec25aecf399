"""Blur, exposure, noise and smear pixel by pixel in numpy; and when a stage is left out."""

from __future__ import annotations

import math

import numpy as np
import pytest

from sim_pybullet.look import SensorLook
from sim_pybullet.sensing.sensor import PX_PER_RAD, Sensors, apply_sensor, smeared

PICTURE = np.random.default_rng(2).integers(0, 256, (1, 24, 160, 3), dtype=np.uint8)


def through(look: SensorLook, picture: np.ndarray = PICTURE, seed: int = 0) -> np.ndarray:
    return apply_sensor(picture, [look], np.random.default_rng(seed))[0].astype(int)


def blurred(picture: np.ndarray, sigma_px: float) -> np.ndarray:
    """(H, W, 3): both ways with a Gaussian cut at three standard deviations; edges repeat."""
    radius = math.ceil(3.0 * sigma_px)
    kernel = np.exp(-0.5 * (np.arange(-radius, radius + 1) / sigma_px) ** 2)
    kernel /= kernel.sum()
    wide = np.pad(picture.astype(float), ((radius, radius), (radius, radius), (0, 0)), "edge")
    height, width = picture.shape[:2]
    rows = sum(k * wide[j : j + height] for j, k in enumerate(kernel))
    return np.asarray(sum(k * rows[:, j : j + width] for j, k in enumerate(kernel)))


@pytest.mark.parametrize("sigma_px", [0.21, 0.5, 1.3, 2.0])
def test_a_blur_is_a_gaussian_cut_at_three_deviations(sigma_px: float) -> None:
    seen = through(SensorLook(blur_px=sigma_px))
    assert np.abs(seen - blurred(PICTURE[0], sigma_px)).max() <= 0.51


def test_a_blur_that_changes_no_level_is_left_out() -> None:
    np.testing.assert_array_equal(through(SensorLook(blur_px=0.199)), PICTURE[0])
    # of a picture half as wide it is half as wide
    small = PICTURE[:, :, :80]
    np.testing.assert_array_equal(through(SensorLook(blur_px=0.39), small), small[0])
    seen = through(SensorLook(blur_px=1.6), small)
    assert np.abs(seen - blurred(small[0], 0.8)).max() <= 0.51


def test_robots_blur_each_by_their_own_width() -> None:
    sensors = Sensors(3, PICTURE.shape[1:])
    for robot, sigma_px in ((1, 0.4), (0, 1.5), (2, 0.7)):
        sensors.put(robot, SensorLook(blur_px=sigma_px))
    sensors.put(1, SensorLook(blur_px=0.4))  # its kernel now stands in a wider row
    frames = np.repeat(PICTURE, 3, axis=0)
    seen = sensors.take(frames, np.array([2, 0, 1]), np.random.default_rng(0))
    for shown, sigma_px in zip(seen, (0.7, 1.5, 0.4), strict=True):
        assert np.abs(shown.astype(int) - blurred(PICTURE[0], sigma_px)).max() <= 0.51


@pytest.mark.parametrize("width", [80, 160])
def test_exposure_vignette_and_noise_in_one_formula(width: int) -> None:
    """Each row of noise begins anywhere in one table; of a smaller picture it is averaged."""
    picture = PICTURE[:, :, :width] // 2 + 90
    look = SensorLook(exposure=1.4, white_balance=(1.1, 0.9, 1.0), vignetting=0.6, noise=6.0)
    seen = through(look, picture, seed=4)
    height = picture.shape[1]
    starts = np.random.default_rng(4).integers(0, 65536, (1, height))[0]
    table = np.random.default_rng(0).standard_normal(65536, np.float32)
    noise = np.stack([np.take(table, s + np.arange(3 * width), mode="wrap") for s in starts])
    row, column = np.arange(height) - 0.5 * (height - 1), np.arange(width) - 0.5 * (width - 1)
    corner = 0.25 * ((width - 1) ** 2 + (height - 1) ** 2)
    shade = 1.0 - 0.6 * (row[:, None] ** 2 + column[None] ** 2) / corner
    light = picture[0] * shade[..., None] * (1.4 * np.array((1.1, 0.9, 1.0)))
    light += 6.0 * (width / 160.0) * noise.reshape(height, width, 3)
    assert np.abs(seen - np.clip(light, 0.0, 255.0)).max() <= 0.52
    assert (seen == 255).any()


def test_black_and_white_are_the_ends() -> None:
    assert through(SensorLook(exposure=9.0)).max() == 255
    dark = np.zeros_like(PICTURE)
    assert through(SensorLook(noise=20.0), dark).min() == 0


@pytest.mark.parametrize("length_px", [0.31, 1.0, 2.4, 5.0])
def test_a_smear_is_a_mean_along_the_row(length_px: float) -> None:
    """A box of that length about each pixel; its ends count by what of a pixel they cover."""
    seen = smeared(PICTURE.copy(), np.array([length_px]))[0].astype(float)
    half = math.ceil(0.5 * length_px)
    weights = np.clip(0.5 * length_px + 0.5 - np.abs(np.arange(-half, half + 1)), 0.0, 1.0)
    wide = np.pad(PICTURE[0].astype(float), ((0, 0), (half, half), (0, 0)), "edge")
    expected = sum(w * wide[:, j : j + 160] for j, w in enumerate(weights / weights.sum()))
    assert np.abs(seen - expected).max() <= 0.51


def test_a_smear_below_a_third_of_a_pixel_is_none() -> None:
    assert smeared(PICTURE, np.array([0.3])) is PICTURE
    both = smeared(np.repeat(PICTURE, 2, axis=0), np.array([0.29, 4.0]))
    np.testing.assert_array_equal(both[0], PICTURE[0])
    assert not np.array_equal(both[1], PICTURE[0])
    assert pytest.approx(76.393, abs=1e-3) == PX_PER_RAD
