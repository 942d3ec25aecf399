"""What sensors make of pictures on a device of torch is what the compiled ones make."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
import torch

from robot.contract import ImageSpec
from robot.lens import DUCKIEBOT_LENS, CameraRig, Mount
from sim_pybullet.look import LightLook, SensorLook
from sim_pybullet.rendering.rays import pixel_rays
from sim_pybullet.sensing.sensor import Mirror, Sensors
from sim_pybullet.sensing.torch_jpeg import compressed
from sim_pybullet.sensing.torch_sensor import TorchSensors
from tests.sim_pybullet.rendering.test_torch_camera import DEVICES, alike

IMAGE = ImageSpec(80, 60, 20)
RAYS = pixel_rays(CameraRig(DUCKIEBOT_LENS, Mount()), IMAGE).directions
LOOKS = {
    "nothing": SensorLook(),
    "shutter": SensorLook(shutter_s=0.03),
    "blur": SensorLook(blur_px=1.8),
    "infrared": SensorLook(infrared=0.4),
    "vignetting": SensorLook(vignetting=0.5),
    "exposure": SensorLook(exposure=1.6, white_balance=(1.2, 0.9, 0.7)),
    "noise": SensorLook(noise=9.0),
    "jpeg": SensorLook(jpeg_quality=40),
}


def pictures(count: int, image: ImageSpec = IMAGE) -> np.ndarray:
    """Patches of colour with noise on them, (N, H, W, 3) uint8."""
    rng, (height, width, _) = np.random.default_rng(0), image.shape
    patches = rng.integers(0, 256, (count, height // 5 + 1, width // 7 + 1, 3))
    large = patches.repeat(5, axis=1).repeat(7, axis=2)[:, :height, :width]
    return np.clip(large + rng.normal(0.0, 6.0, large.shape), 0, 255).astype(np.uint8)


def both(
    looks: list[SensorLook], device: str, lights: list[LightLook | None]
) -> tuple[np.ndarray, torch.Tensor]:
    """What each kind makes of the same pictures of turning robots."""
    count, frames = len(looks), pictures(len(looks))
    compiled = Sensors(count, IMAGE.shape, IMAGE.crop_top_px)
    drawn = TorchSensors(count, IMAGE.shape, IMAGE.crop_top_px, device)
    for i, (look, light) in enumerate(zip(looks, lights, strict=True)):
        for sensors in (compiled, drawn):
            sensors.put(i, look, light and Mirror(light, RAYS))
    turns, headings = np.linspace(-2.4, 2.0, count), np.linspace(-3.0, 3.0, count)
    rest = np.arange(count), np.random.default_rng(1), turns, headings
    seen = drawn.take(
        torch.from_numpy(frames).to(device), rest[0], np.random.default_rng(1), *rest[2:]
    )
    return compiled.take(frames.copy(), *rest), seen


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("name", LOOKS)
def test_each_stage_is_that_of_the_compiled_sensors(name: str, device: str) -> None:
    expected, seen = both([LOOKS[name]] * 6, device, [None] * 6)
    alike(seen, expected)
    assert (name == "nothing") == bool((expected == pictures(6)).all()), "the stage does something"


@pytest.mark.parametrize("device", DEVICES)
def test_a_floor_mirrors_the_light(device: str) -> None:
    light = LightLook(azimuth_rad=0.3, elevation_rad=0.5, gloss=0.7, gloss_width_rad=0.3)
    expected, seen = both([SensorLook()] * 6, device, [light, None] * 3)
    alike(seen, expected)
    changed = (expected != pictures(6)).any(axis=(1, 2, 3))
    assert not changed[1::2].any()
    assert changed.any()


@pytest.mark.parametrize("device", DEVICES)
def test_sensors_differ_from_robot_to_robot(device: str) -> None:
    """All stages but JPEG and bright gains, which make more of a grey level."""
    every = SensorLook(0.02, 1.2, 0.3, 0.4, 0.8, (1.1, 1.0, 0.8), 5.0)
    light = LightLook(azimuth_rad=0.3, elevation_rad=0.5, gloss=0.7, gloss_width_rad=0.3)
    looks = [every, SensorLook(), replace(every, blur_px=0.0), replace(every, noise=0.0)]
    expected, seen = both(looks, device, [light, light, None, light])
    alike(seen, expected)


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("size", [(80, 60, 20), (160, 120, 0), (75, 51, 0)])
def test_jpeg_is_libjpegs_to_the_bit(size: tuple[int, int, int], device: str) -> None:
    qualities = [1, 10, 35, 49, 50, 60, 75, 90, 95, 99]
    frames = pictures(len(qualities), ImageSpec(*size))
    expected = []
    for frame, quality in zip(frames, qualities, strict=True):
        bgr = cv2.cvtColor(frame, cv2.COLOR_RGB2BGR)
        data = cv2.imencode(".jpg", bgr, (cv2.IMWRITE_JPEG_QUALITY, quality))[1]
        expected.append(cv2.cvtColor(cv2.imdecode(data, cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB))
    taken = torch.from_numpy(frames).to(device).float()
    seen = compressed(taken, torch.tensor(qualities, device=device))
    np.testing.assert_array_equal(seen.cpu().numpy(), np.array(expected))
