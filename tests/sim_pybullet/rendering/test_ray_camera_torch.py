import numpy as np
import pytest

from robot.contract import ImageSpec
from robot.navigation.road_map import load_map
from sim_pybullet.look import NOMINAL, CameraLook, LightLook, Look
from sim_pybullet.rendering.ray_camera import RayCamera
from sim_pybullet.rendering.ray_camera_torch import TorchRayCamera
from sim_pybullet.scenery.objects import build_scene
from sim_pybullet.show_cameras import lane_poses

IMAGE = ImageSpec(96, 72, 12)


@pytest.fixture(scope="module")
def cameras() -> tuple[RayCamera, TorchRayCamera, np.ndarray]:
    """Two maps, two lights and three rigs among six robots."""
    rng = np.random.default_rng(0)
    pair = RayCamera(IMAGE, 6), TorchRayCamera(IMAGE, 6, device="cpu")
    poses = np.zeros((6, 3))
    for i in range(6):
        look = Look(
            camera=CameraLook(pitch_rad=0.2 + 0.1 * (i % 3), roll_rad=0.05 * i),
            light=LightLook(azimuth_rad=float(i), ambient=0.6 - 0.1 * (i % 2)),
        )
        road_map = load_map("town" if i % 2 else "loop")
        scene = build_scene(road_map, look, rng)
        poses[i] = lane_poses(road_map, 1, rng)[0]
        for camera in pair:
            camera.set_robot(i, scene, look.rig())
    return (*pair, poses)


def test_both_ways_of_drawing_agree_within_two_grey_levels(
    cameras: tuple[RayCamera, TorchRayCamera, np.ndarray],
) -> None:
    compiled, drawn, poses = cameras
    expected, frames = compiled.render(poses), drawn.render(poses)
    assert frames.dtype == np.uint8
    difference = np.abs(expected.astype(int) - frames)
    assert np.mean(difference > 2) < 1e-4  # a ray that grazes an edge may fall on either side
    assert difference.mean() < 0.05
    assert np.mean(compiled.segment(poses) == drawn.segment(poses)) > 0.9995


def test_some_robots_are_drawn_as_all_are(
    cameras: tuple[RayCamera, TorchRayCamera, np.ndarray],
) -> None:
    _, drawn, poses = cameras
    some = np.array([4, 1])
    assert np.array_equal(drawn.render(poses[some], some), drawn.render(poses)[some])


def test_pictures_drawn_in_parts_are_the_same(
    cameras: tuple[RayCamera, TorchRayCamera, np.ndarray], monkeypatch: pytest.MonkeyPatch
) -> None:
    _, drawn, poses = cameras
    whole, labels = drawn.render(poses), drawn.segment(poses)
    monkeypatch.setattr("sim_pybullet.rendering.ray_camera_torch.MOST_PIXELS", 2 * 96 * 60)
    assert np.array_equal(drawn.render(poses), whole)
    assert np.array_equal(drawn.segment(poses), labels)


def test_a_robot_may_move_to_another_world() -> None:
    rng = np.random.default_rng(1)
    compiled, drawn = RayCamera(IMAGE, 1), TorchRayCamera(IMAGE, 1, device="cpu")
    poses = np.array([[0.9, 0.3, 0.2]])
    for name in ("loop", "town", "arena", "loop"):
        scene = build_scene(load_map(name), NOMINAL, rng)
        for camera in (compiled, drawn):
            camera.set_robot(0, scene, NOMINAL.rig())
        difference = np.abs(compiled.render(poses).astype(int) - drawn.render(poses))
        assert difference.mean() < 0.05
