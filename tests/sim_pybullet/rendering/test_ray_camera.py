import math
import os
import subprocess
import sys

import numba
import numpy as np
import pytest
from numpy.testing import assert_array_equal

from robot.contract import ImageSpec
from robot.geometry import Pose
from robot.lens import DUCKIEBOT_LENS, CameraRig, Lens
from robot.navigation.road_map import load_map
from sim_pybullet.look import NOMINAL, CameraLook, LightLook, Look, SkyLook
from sim_pybullet.rendering.ray_camera import RayCamera
from sim_pybullet.scene import Ground, Scene, SemanticClass
from sim_pybullet.scenery.objects import build_scene

FULL_LIGHT = LightLook(ambient=1.0, diffuse=0.0)
SMALL = ImageSpec(80, 60, 20)
LENSES = {
    "pinhole": Lens("pinhole", 64, 48, 40.0, 40.0, 31.5, 23.5),
    "plumb_bob": DUCKIEBOT_LENS,
    "fisheye": Lens("fisheye", 320, 240, 110.0, 110.0, 160.0, 118.0, (-0.02, 0.003, 0.0, 0.0)),
}


def camera_on(scene: Scene, rig: CameraRig, image: ImageSpec = SMALL, n: int = 1) -> RayCamera:
    camera = RayCamera(image, n)
    for i in range(n):
        camera.set_robot(i, scene, rig)
    return camera


def smooth_scene(kinds: np.ndarray | None = None) -> Scene:
    """A floor whose colour says where one is: red grows east, green grows north."""
    rows, columns = 600, 800
    rgb = np.zeros((rows, columns, 3), np.uint8)
    rgb[..., 0] = np.linspace(10, 240, columns)
    rgb[..., 1] = np.linspace(240, 10, rows)[:, None]
    classes = np.full((rows, columns), SemanticClass.ROAD, np.uint8) if kinds is None else kinds
    ground = Ground(rgb, classes, 0.005, -2.0, 1.5, (9.0, 9.0, 200.0))
    return Scene(ground, (), SkyLook(), FULL_LIGHT)


@pytest.mark.parametrize("name", sorted(LENSES))
def test_a_pixel_shows_the_floor_point_that_its_ray_meets(name: str) -> None:
    scene, rig = smooth_scene(), CameraRig(LENSES[name])
    pose = Pose(0.2, -0.1, 2.0)
    frame = camera_on(scene, rig).render(np.array([pose]))[0]
    lens = rig.lens.scaled(SMALL.width_px, SMALL.height_px)
    v, u = np.mgrid[25:60:5, 5:80:5]
    floor = CameraRig(lens, rig.mount).to_floor(np.stack((u, v), axis=-1).astype(float))
    world = pose.to_world(floor)
    inside = (np.abs(world[..., 0]) < 1.9) & (np.abs(world[..., 1]) < 1.4)
    inside &= np.hypot(*np.moveaxis(floor, -1, 0)) < 1.0
    assert inside.sum() > 30
    red = 10 + 230 * (world[..., 0] + 2.0) / 4.0
    green = 10 + 230 * (world[..., 1] + 1.5) / 3.0
    shown = frame[v - SMALL.crop_top_px, u].astype(float)
    assert np.abs(shown[..., 0] - red)[inside].max() < 3.0
    assert np.abs(shown[..., 1] - green)[inside].max() < 3.0


@pytest.mark.parametrize("name", sorted(LENSES))
def test_labels_are_those_of_the_floor_point(name: str) -> None:
    kinds = np.random.default_rng(1).integers(1, 12, (6, 8)).astype(np.uint8)
    scene, rig = (
        smooth_scene(np.kron(kinds, np.ones((100, 100), np.uint8))),
        CameraRig(LENSES[name]),
    )
    pose = Pose(-0.3, 0.2, -1.0)
    labels = camera_on(scene, rig).segment(np.array([pose]))[0]
    lens = rig.lens.scaled(SMALL.width_px, SMALL.height_px)
    v, u = np.mgrid[SMALL.crop_top_px : SMALL.height_px, 0 : SMALL.width_px]
    world = pose.to_world(
        CameraRig(lens, rig.mount).to_floor(np.stack((u, v), axis=-1).astype(float))
    )
    column, row = (world[..., 0] + 2.0) / 0.5, (1.5 - world[..., 1]) / 0.5
    inside = (column >= 0) & (column < 8) & (row >= 0) & (row < 6)
    expected = kinds[np.where(inside, row, 0).astype(int), np.where(inside, column, 0).astype(int)]
    expected = np.where(inside, expected, SemanticClass.OUTSIDE)
    expected = np.where(np.isfinite(column), expected, SemanticClass.SKY)
    assert np.mean(labels == expected) > 0.995


def test_moving_world_and_robot_together_changes_nothing() -> None:
    scene = build_scene(load_map("loop"), NOMINAL, np.random.default_rng(0))
    ground = scene.ground
    moved = Ground(ground.rgb, ground.classes, ground.texel_m, 3.0, -2.0, ground.outside_rgb)
    turned = Ground(
        np.rot90(ground.rgb),
        np.rot90(ground.classes),
        ground.texel_m,
        -ground.north_m,
        ground.classes.shape[1] * ground.texel_m,
        ground.outside_rgb,
    )
    pose = np.array([[1.0, 0.3, 0.4]])
    shift = np.array([[3.0, -2.0 - ground.north_m, 0.0]])
    frame = camera_on(scene, NOMINAL.rig()).render(pose).astype(int)
    other = Scene(moved, (), scene.sky, scene.light)
    assert np.abs(camera_on(other, NOMINAL.rig()).render(pose + shift) - frame).max() < 3
    other = Scene(turned, (), scene.sky, scene.light)
    quarter = np.array([[-0.3, 1.0, 0.4 + math.pi / 2]])
    assert np.abs(camera_on(other, NOMINAL.rig()).render(quarter) - frame).max() < 3


def test_frames_repeat_and_share_no_memory() -> None:
    scene = build_scene(load_map("loop"), NOMINAL, np.random.default_rng(0))
    camera = camera_on(scene, NOMINAL.rig(), n=3)
    poses = np.array([[0.5, 0.5, 0.1], [1.0, 0.3, 2.0], [0.3, 1.0, -2.0]])
    first, second = camera.render(poses), camera.render(poses)
    assert_array_equal(first, second)
    assert_array_equal(camera.segment(poses), camera.segment(poses))
    kept = first.copy()
    camera.render(poses[::-1])
    second[:] = 0
    assert_array_equal(first, kept)


def draw_with_one_thread_and_with_two() -> None:
    """For a process that may have two; the world is painted anew for each."""
    poses = np.random.default_rng(0).uniform((0.5, 0.5, -3.0), (4.0, 4.0, 3.0), (5, 3))
    drawn = []
    for threads in (1, 2):
        numba.set_num_threads(threads)
        scene = build_scene(load_map("town"), NOMINAL, np.random.default_rng(0))
        assert scene.solids
        camera = camera_on(scene, NOMINAL.rig(), n=5)
        some = camera.render(poses[:1], np.array([0]))
        drawn.append((scene.ground.rgb, camera.render(poses), camera.segment(poses), some))
    for one, two in zip(*drawn, strict=True):
        assert_array_equal(one, two)


def test_pictures_are_the_same_whether_one_thread_draws_or_two() -> None:
    drawing = f"import {__name__} as it; it.draw_with_one_thread_and_with_two()"
    two = {**os.environ, "NUMBA_NUM_THREADS": "2"}
    subprocess.run([sys.executable, "-c", drawing], env=two, check=True)


def test_robots_keep_their_own_scene_and_rig() -> None:
    town, loop = (
        build_scene(load_map(name), NOMINAL, np.random.default_rng(0)) for name in ("town", "loop")
    )
    rigs = [Look(camera=CameraLook(pitch_rad=p)).rig() for p in (0.2, 0.35, 0.5)]
    poses = np.array([[0.7, 0.5, 0.3]] * 6)
    worlds = [(scene, rig) for scene in (town, loop) for rig in rigs]
    together = RayCamera(SMALL, 6)
    for _ in range(2):  # given again, in another order: tables and textures are reused
        for i, (scene, rig) in enumerate(worlds):
            together.set_robot(i, scene, rig)
        frames = together.render(poses)
        for i, (scene, rig) in enumerate(worlds):
            assert_array_equal(frames[i], camera_on(scene, rig).render(poses[:1])[0])
        worlds.reverse()


def test_some_robots_alone_see_what_they_see_among_all() -> None:
    scenes = [
        build_scene(load_map("town"), Look(sky=SkyLook(horizon_rgb=rgb)), np.random.default_rng(0))
        for rgb in ((250.0, 10.0, 10.0), (10.0, 10.0, 250.0))
    ]
    camera = RayCamera(SMALL, 4)
    for i in range(4):
        look = Look(camera=CameraLook(height_m=0.1 + 0.01 * i))
        camera.set_robot(i, scenes[i % 2], look.rig())
    poses = np.random.default_rng(0).uniform((0.5, 0.5, -3.0), (4.0, 4.0, 3.0), (4, 3))
    some = np.array([3, 1])
    assert_array_equal(camera.render(poses[some], some), camera.render(poses)[some])
    assert_array_equal(camera.render(poses[::-1], np.arange(4)[::-1]), camera.render(poses)[::-1])


def test_above_the_horizon_is_sky_and_far_away_is_outside() -> None:
    scene = smooth_scene()
    camera = camera_on(scene, NOMINAL.rig(), ImageSpec(160, 120))
    pose = np.array([[0.0, 0.0, 0.0]])
    labels, frame = camera.segment(pose)[0], camera.render(pose)[0]
    assert (labels[0] == SemanticClass.SKY).all()
    horizon = int(np.argmax(labels[:, 80] != SemanticClass.SKY))
    assert labels[horizon, 80] == SemanticClass.OUTSIDE
    assert_array_equal(frame[horizon, 80], (9, 9, 200))


def test_wrong_number_of_poses_is_refused() -> None:
    camera = RayCamera(SMALL, 2)
    with pytest.raises(ValueError, match=r"expected poses \(2, 3\) and set_robot"):
        camera.render(np.zeros((2, 3)))


def test_beyond_the_fold_of_a_lens_is_black() -> None:
    """A plumb-bob polynomial that turns back maps nothing to the pixels beyond its turning."""
    folded = Lens("plumb_bob", 80, 60, 25.0, 25.0, 39.5, 29.5, (-0.3, 0.0, 0.0, 0.0))
    camera = camera_on(smooth_scene(), CameraRig(folded), ImageSpec(80, 60))
    frame, labels = camera.render(np.zeros((1, 3)))[0], camera.segment(np.zeros((1, 3)))[0]
    assert_array_equal(frame[0, 0], (0, 0, 0))
    assert_array_equal(frame[-1, -1], (0, 0, 0))
    assert labels[-1, -1] == SemanticClass.SKY
    assert frame[40, 40].any()


def test_no_robots_make_no_pictures() -> None:
    camera = camera_on(smooth_scene(), NOMINAL.rig(), n=2)
    assert camera.render(np.zeros((0, 3)), np.zeros(0, int)).shape == (0, *camera.shape)
