import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot.contract import ImageSpec
from robot.lens import DUCKIEBOT_LENS, CameraRig, Mount
from sim_pybullet.look import LightLook, SensorLook
from sim_pybullet.rendering.rays import pixel_rays
from sim_pybullet.sensing.sensor import PX_PER_RAD, apply_sensor, smeared
from tests.sim_pybullet.sensing.gloss import add_gloss

POST = np.zeros((1, 20, 60, 3), np.uint8)
POST[:, :, 30] = 200
RIG = CameraRig(DUCKIEBOT_LENS, Mount())


def reddened(pictures: np.ndarray, *shares: float) -> np.ndarray:
    looks = [SensorLook(infrared=share) for share in shares]
    return apply_sensor(pictures, looks, np.random.default_rng(0))


@pytest.mark.parametrize("length", [1.0, 2.5, 7.0])
def test_a_smear_spreads_light_along_the_row_and_keeps_its_sum(length: float) -> None:
    seen = smeared(POST.copy(), np.array([length]))[0, 10, :, 0].astype(float)
    assert seen.sum() == pytest.approx(200.0, abs=len(seen) * 0.5)
    assert (seen > 0).sum() == pytest.approx(length, abs=2.0)
    assert seen[31:40] == pytest.approx(seen[29:20:-1], abs=1.0)
    assert smeared(POST, np.array([0.0])) is POST


def test_only_turning_robots_smear_and_as_far_as_they_turn() -> None:
    look = SensorLook(shutter_s=0.05)
    rng = np.random.default_rng(0)
    still = apply_sensor(POST, [look], rng, turns_radps=np.zeros(1))
    turning = apply_sensor(POST, [look], rng, turns_radps=np.array([-2.4]))
    np.testing.assert_array_equal(still, POST)
    width = (turning[0, 10, :, 0] > 0).sum()
    assert width == pytest.approx(0.05 * 2.4 * PX_PER_RAD * 60 / 160, abs=2.0)


def test_infrared_washes_colours_out_and_keeps_black() -> None:
    colours = np.array([[[[200, 40, 40], [40, 200, 40], [0, 0, 0]]]], np.uint8)
    spread = [np.ptp(reddened(colours, share)[0, 0, 0]) for share in (0.0, 0.3, 0.8)]
    assert spread[0] > spread[1] > spread[2]
    assert not reddened(colours, 0.5)[0, 0, 2].any()


def test_a_lamp_ahead_shines_in_the_floor_ahead_and_turns_with_the_robot() -> None:
    light = LightLook(azimuth_rad=0.0, elevation_rad=0.5, gloss=0.8, gloss_width_rad=0.2)
    seen = []
    for heading in (0.0, 0.4, -0.4, np.pi):
        frame = np.full((120, 160, 3), 50, np.uint8)
        add_gloss(frame, RIG, ImageSpec(), light, heading)
        assert frame.min() == 50
        seen.append(frame[..., 0])
    middles = [np.unravel_index(frame.argmax(), frame.shape)[1] for frame in seen[:3]]
    assert middles[1] > middles[0] + 15  # the robot turned left: the lamp is to the right
    assert middles[2] < middles[0] - 15
    assert seen[3].max() < 60


@given(st.floats(-3.0, 3.0), st.floats(0.1, 1.5), st.floats(0.05, 2.0), st.floats(0.02, 0.6))
def test_gloss_is_phongs_lamp_on_the_floor(
    heading: float, elevation: float, gloss: float, width: float
) -> None:
    light = LightLook(azimuth_rad=0.3, elevation_rad=elevation, gloss=gloss, gloss_width_rad=width)
    frame = np.full((60, 80, 3), 50, np.uint8)
    image = ImageSpec(80, 60)
    add_gloss(frame, RIG, image, light, heading)
    rays = pixel_rays(RIG, image).directions.astype(float)
    lamp = np.array((np.cos(0.3 - heading), np.sin(0.3 - heading), 0.0)) * np.cos(elevation)
    lamp[2] = -np.sin(elevation)
    spot = np.exp((np.minimum(rays @ lamp, 1.0) - 1.0) / width**2) * (rays[..., 2] < 0.0)
    expected = np.minimum(50.0 + 200.0 * gloss * spot, 255.0)
    assert np.abs(frame - expected[..., None]).max() <= 0.6
