"""Pictures drawn on a device of torch are those of the compiled camera."""

import numpy as np
import pytest
import torch

from robot.contract import ImageSpec
from robot.navigation.map_objects import MapObject
from robot.navigation.road_map import load_map
from sim_pybullet.randomise import load_look_sampler
from sim_pybullet.rendering.ray_camera import RayCamera
from sim_pybullet.rendering.torch_camera import TorchCamera
from sim_pybullet.scenery.object_solids import object_solids
from sim_pybullet.scenery.objects import build_scene
from tests.sim_pybullet.test_camera_parity import road_poses

DEVICES = ["cpu", *(["cuda"] if torch.cuda.is_available() else [])]
IMAGES = {"small": ImageSpec(80, 60, 20), "whole": ImageSpec(160, 120)}
DUCK = object_solids(MapObject("duck", "duckie", 0.0, 0.0, 0.0, 0.08))
CAR = object_solids(MapObject("car", "duckiebot", 0.0, 0.0, 0.0, 0.135, color="red"))
ROBOTS = 12


def cameras(image: ImageSpec, device: str, look: str) -> tuple[RayCamera, TorchCamera]:
    """The same robots, each with a rig and a light of its own, every third world shared."""
    both = RayCamera(image, ROBOTS, (DUCK, CAR)), TorchCamera(image, ROBOTS, (DUCK, CAR), device)
    rng, sample = np.random.default_rng(3), load_look_sampler(look)
    for i in range(ROBOTS):
        drawn = sample(rng)
        if i % 3 == 0:
            scene = build_scene(load_map("town"), drawn, rng)
        for camera in both:
            camera.set_robot(i, scene, drawn.rig())
    return both


def moving_before(poses: np.ndarray) -> np.ndarray:
    """A duck and a car ahead of each robot; not before the first, no car before the second."""
    rng = np.random.default_rng(2)
    ahead, aside = rng.uniform(0.15, 0.6, (ROBOTS, 2)), rng.uniform(-0.2, 0.2, (ROBOTS, 2))
    c, s = np.cos(poses[:, 2:]), np.sin(poses[:, 2:])
    x, y = poses[:, :1] + c * ahead - s * aside, poses[:, 1:2] + s * ahead + c * aside
    moving = np.stack((x, y, rng.uniform(-np.pi, np.pi, (ROBOTS, 2))), axis=-1)
    moving[0], moving[1, 1] = np.nan, np.nan
    return moving


def alike(seen: torch.Tensor, expected: np.ndarray) -> None:
    """At most one grey level apart in 99.9 % of the pixels."""
    apart = np.abs(seen.cpu().numpy().astype(int) - expected).max(axis=-1)
    assert seen.shape == expected.shape
    assert (apart <= 1).mean() >= 0.999
    assert expected.std() > 20.0, "there is something to see"


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize(
    ("size", "look"),
    [("small", "nominal"), ("small", "randomised"), ("small", "wide"), ("whole", "randomised")],
)
def test_pictures_are_those_of_the_compiled_camera(size: str, look: str, device: str) -> None:
    compiled, drawn = cameras(IMAGES[size], device, look)
    for seed in range(3):
        poses = road_poses(load_map("town"), ROBOTS, seed)
        around = moving_before(poses)
        alike(drawn.render(poses, None, around), compiled.render(poses, None, around))
        some = np.array([7, 2, 3])
        seen = drawn.render(poses[some], some, around[some])
        alike(seen, compiled.render(poses[some], some, around[some]))


@pytest.mark.parametrize("device", DEVICES)
def test_what_a_robot_sees_follows_its_world_and_rig(device: str) -> None:
    """Also after so many worlds that the first ones have left the device."""
    compiled, drawn = cameras(IMAGES["small"], device, "randomised")
    rng, sample = np.random.default_rng(8), load_look_sampler("randomised")
    poses = road_poses(load_map("town"), ROBOTS)
    nobody = np.full((ROBOTS, 2, 3), np.nan)
    for i in (0, 4, 4, 11, 0, 3, 4):
        look = sample(rng)
        scene = build_scene(load_map("town"), look, rng)
        for camera in (compiled, drawn):
            camera.set_robot(i, scene, look.rig())
        alike(drawn.render(poses, None, nobody), compiled.render(poses, None, nobody))


@pytest.mark.parametrize("device", DEVICES)
def test_pictures_stay_on_the_device(device: str) -> None:
    camera = cameras(IMAGES["small"], device, "nominal")[1]
    poses = road_poses(load_map("town"), ROBOTS)
    pictures = camera.render(poses, None, moving_before(poses))
    assert (pictures.device.type, pictures.dtype) == (device, torch.uint8)
    again = camera.render(poses, None, moving_before(poses))
    assert torch.equal(pictures, again)
    assert pictures.data_ptr() != again.data_ptr(), "each in memory of its own"
