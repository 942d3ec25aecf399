"""Stages of the sensor against the plain ones that they stand for."""

import math

import cv2
import numpy as np
import pytest

from robot.contract import ImageSpec
from sim_pybullet.look import LightLook, SensorLook
from sim_pybullet.randomise import load_look_sampler
from sim_pybullet.rendering.rays import pixel_rays
from sim_pybullet.sensing.sensor import apply_sensor
from tests.sim_pybullet.sensing.gloss import add_gloss


def pictures(height: int, width: int) -> list[np.ndarray]:
    """Noise, soft colours, and black and white dots."""
    rng = np.random.default_rng(0)
    noise = rng.integers(0, 256, (height, width, 3), dtype=np.uint8)
    coarse = rng.integers(0, 256, (height // 8 + 2, width // 8 + 2, 3), dtype=np.uint8)
    soft = cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC)
    dots = np.where(rng.random((height, width, 1)) < 0.5, 0, 255).astype(np.uint8)
    return [noise, soft, np.repeat(dots, 3, axis=2)]


def written_and_read(picture: np.ndarray, quality: int) -> np.ndarray:
    parameters = (cv2.IMWRITE_JPEG_QUALITY, quality)
    _, data = cv2.imencode(".jpg", np.ascontiguousarray(picture[..., ::-1]), parameters)
    return np.asarray(cv2.imdecode(data, cv2.IMREAD_COLOR))[..., ::-1]


@pytest.mark.parametrize(("height", "width"), [(40, 80), (120, 160), (32, 48), (17, 23), (9, 8)])
def test_jpeg_is_what_opencv_writes_and_reads(height: int, width: int) -> None:
    for quality in (1, 10, 49, 50, 60, 75, 90, 99):
        for picture in pictures(height, width):
            look = SensorLook(jpeg_quality=quality)
            seen = apply_sensor(picture[None], [look], np.random.default_rng(0))[0]
            np.testing.assert_array_equal(seen, written_and_read(picture, quality))


def test_infrared_is_opencvs_transform() -> None:
    pink = np.array((1.15, 0.85, 1.05))
    for share in (0.01, 0.12, 0.3, 0.77, 1.0):
        mixing = (1.0 - share) * np.eye(3) + share * np.outer(pink, np.full(3, 1 / 3))
        for picture in pictures(40, 80):
            look = SensorLook(infrared=share)
            seen = apply_sensor(picture[None], [look], np.random.default_rng(0))[0]
            np.testing.assert_array_equal(seen, cv2.transform(picture, mixing))


def test_gloss_is_the_formula_in_numpy() -> None:
    rng, sample = np.random.default_rng(3), load_look_sampler("randomised")
    image, lit = ImageSpec(80, 60, crop_top_px=20), 0
    for _ in range(20):
        look, heading = sample(rng), rng.uniform(-math.pi, math.pi)
        light = LightLook(look.light.azimuth_rad, look.light.elevation_rad, gloss=0.5)
        plain = pictures(40, 80)[1]
        seen = plain.copy()
        add_gloss(seen, look.rig(), image, light, heading)
        rays = pixel_rays(look.rig(), image).directions.astype(float)
        flat, azimuth = math.cos(light.elevation_rad), light.azimuth_rad - heading
        lamp = (flat * math.cos(azimuth), flat * math.sin(azimuth), -math.sin(light.elevation_rad))
        spot = 100.0 * np.exp((rays @ lamp - 1.0) / light.gloss_width_rad**2)
        wanted = np.minimum(plain + np.where(rays[..., 2] < 0.0, spot, 0.0)[..., None], 255.0)
        assert np.abs(seen - wanted).max() <= 0.61, "half a level, and what is too dim to be drawn"
        lit += int((seen > plain).any())
    assert lit > 5
