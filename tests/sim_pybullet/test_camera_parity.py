"""Both cameras draw the same picture of the same scene."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from skimage.metrics import structural_similarity

from robot.contract import ImageSpec
from robot.lens import DUCKIEBOT_LENS, CameraRig, Lens, Mount
from robot.navigation.map_objects import MapObject, objects_of
from robot.navigation.road_map import RoadMap, load_map
from sim_pybullet.look import NOMINAL, GroundLook, LightLook, Look
from sim_pybullet.rendering.ray_camera import RayCamera
from sim_pybullet.scene import Scene, SemanticClass
from sim_pybullet.scenery.object_solids import object_solids
from sim_pybullet.scenery.objects import build_scene
from tests.robot.real_lenses import real_lenses
from tests.sim_pybullet.pybullet_camera import PyBulletCamera
from tests.thorough import count

FRAME = ImageSpec(160, 120)
LINES = (SemanticClass.WHITE_LINE, SemanticClass.YELLOW_LINE, SemanticClass.RED_LINE)
WIDE = Lens("fisheye", 640, 480, 196.0, 196.0, 319.5, 239.5, (0.0, 0.0, 0.0, 0.0))  # 187 degrees
LENSES = {
    "pinhole": Lens("pinhole", 64, 48, 40.0, 40.0, 31.5, 23.5),
    "plumb_bob": DUCKIEBOT_LENS,
    "fisheye": Lens("fisheye", 320, 240, 110.0, 110.0, 160.0, 118.0, (-0.02, 0.003, 0.0, 0.0)),
    "beyond a half-space": WIDE,
}


def road_poses(road_map: RoadMap, count: int, seed: int = 0) -> np.ndarray:
    """Random poses on the road, clear of what stands beside it."""
    rng, objects = np.random.default_rng(seed), objects_of(road_map)
    poses: list[tuple[float, float, float]] = []
    while len(poses) < count:
        x, y = rng.uniform(0.0, road_map.width_m), rng.uniform(0.0, road_map.height_m)
        clear = all(np.hypot(x - o.x_m, y - o.y_m) > 0.25 for o in objects)
        if clear and road_map.on_road(x, y):
            poses.append((x, y, rng.uniform(-np.pi, np.pi)))
    return np.array(poses)


@contextmanager
def both(
    scene: Scene, rig: CameraRig, image: ImageSpec, count: int, oversample: int = 3
) -> Iterator[tuple[PyBulletCamera, RayCamera]]:
    ray = RayCamera(image, count)
    for i in range(count):
        ray.set_robot(i, scene, rig)
    reference = PyBulletCamera(scene, rig, image, oversample)
    try:
        yield reference, ray
    finally:
        reference.close()


def likeness(first: np.ndarray, second: np.ndarray) -> float:
    pairs = zip(first, second, strict=True)
    return float(np.mean([structural_similarity(a, b, channel_axis=-1) for a, b in pairs]))


def overlap(first: np.ndarray, second: np.ndarray) -> float:
    """Intersection over union of the lane markings of all pictures together."""
    a, b = np.isin(first, LINES), np.isin(second, LINES)
    return float((a & b).sum() / (a | b).sum())


def assert_parity(count: int) -> None:
    town = load_map("town")
    scene = build_scene(town, NOMINAL, np.random.default_rng(0))
    poses = road_poses(town, count)
    with both(scene, NOMINAL.rig(), FRAME, count) as (reference, ray):
        assert likeness(reference.render(poses), ray.render(poses)) > 0.95
        expected, labels = reference.segment(poses), ray.segment(poses)
        assert overlap(expected, labels) > 0.9
        assert np.mean(expected == labels) > 0.98


def test_cameras_agree() -> None:
    assert_parity(count(20, 200))


@pytest.mark.parametrize("name", LENSES)
def test_cameras_agree_through_every_kind_of_lens(name: str) -> None:
    loop = load_map("loop")
    scene = build_scene(loop, NOMINAL, np.random.default_rng(0))
    rig = CameraRig(LENSES[name], Mount(left_m=0.02, yaw_rad=0.2, roll_rad=-0.1))
    poses = road_poses(loop, 4)
    with both(scene, rig, ImageSpec(96, 72, 10), 4) as (reference, ray):
        assert likeness(reference.render(poses), ray.render(poses)) > 0.95
        assert np.mean(reference.segment(poses) == ray.segment(poses)) > 0.98


def test_cameras_agree_through_the_lenses_of_real_robots(data_dir: Path) -> None:
    loop = load_map("loop")
    scene = build_scene(loop, NOMINAL, np.random.default_rng(0))
    poses = road_poses(loop, 3)
    for lens in real_lenses(data_dir):
        rig = CameraRig(lens)
        with both(scene, rig, ImageSpec(80, 60), 3) as (reference, ray):
            assert likeness(reference.render(poses), ray.render(poses)) > 0.95, lens


def test_cameras_agree_under_another_light_on_a_worn_floor() -> None:
    town = load_map("town")
    look = Look(
        ground=GroundLook(wear=0.6, patchiness=0.8, brightness=1.3, grain=10.0),
        light=LightLook(azimuth_rad=-2.0, elevation_rad=0.5, ambient=0.4, diffuse=0.5),
    )
    scene = build_scene(town, look, np.random.default_rng(1))
    poses = road_poses(town, 5, seed=3)
    with both(scene, look.rig(), FRAME, 5) as (reference, ray):
        expected, frames = reference.render(poses).astype(int), ray.render(poses)
        assert likeness(expected.astype(np.uint8), frames) > 0.95
        assert abs(np.mean(expected - frames)) < 1.0  # TinyRenderer cuts off half a grey level


def test_a_view_covers_the_whole_lens() -> None:
    """No pixel of the lens lies outside the pinhole pictures that it is read from."""
    scene = build_scene(load_map("loop"), NOMINAL, np.random.default_rng(0))
    for lens in LENSES.values():
        with both(scene, CameraRig(lens), ImageSpec(64, 48), 1, 2) as (reference, _):
            cover = reference.cover
            for k, (view, where) in enumerate(zip(cover.views, cover.maps, strict=True)):
                mine = where[:, (cover.owner == k) & cover.seen].T
                assert (mine >= 0).all()
                assert (mine <= view.size_px - 1).all()


def test_the_reference_repeats_itself_in_fresh_memory() -> None:
    loop = load_map("loop")
    scene = build_scene(loop, NOMINAL, np.random.default_rng(0))
    poses = road_poses(loop, 2)
    with both(scene, NOMINAL.rig(), ImageSpec(64, 48), 2, 1) as (reference, _):
        first = reference.render(poses)
        kept = first.copy()
        reference.segment(poses)
        again = reference.render(poses)
        assert np.array_equal(first, again)
        again[:] = 0
        assert np.array_equal(first, kept)
        assert not np.shares_memory(first, again)


def test_a_small_render_is_the_shrunken_large_render() -> None:
    """Training may draw small pictures directly: what preprocessing would make of large ones.

    Preprocessing averages the large picture's pixels; the ray camera averages over the small
    pixel's footprint itself. They differ by less than two grey levels on average.
    """
    import cv2

    town = load_map("town")
    scene = build_scene(town, NOMINAL, np.random.default_rng(0))
    poses = road_poses(town, 10)
    spec = ImageSpec(80, 60, 20)
    large, small = RayCamera(replace(FRAME), 10), RayCamera(spec, 10)
    for i in range(10):
        large.set_robot(i, scene, NOMINAL.rig())
        small.set_robot(i, scene, NOMINAL.rig())
    shrunken = [
        cv2.resize(frame, (80, 60), interpolation=cv2.INTER_AREA)[20:]
        for frame in large.render(poses)
    ]
    assert np.abs(np.array(shrunken, int) - small.render(poses)).mean() < 2.0
    assert likeness(np.array(shrunken), small.render(poses)) > 0.97


def test_cameras_agree_on_what_moves() -> None:
    """Ducks and robots are drawn where they are in each picture, and nowhere if they are away."""
    town = load_map("town")
    scene = build_scene(town, NOMINAL, np.random.default_rng(0))
    duck = object_solids(MapObject("duck", "duckie", 0.0, 0.0, 0.0, 0.08))
    car = object_solids(MapObject("car", "duckiebot", 0.0, 0.0, 0.0, 0.135, color="red"))
    movers, count = (duck, car), 8
    poses, rng = road_poses(town, count), np.random.default_rng(2)
    ahead_m, aside_m = rng.uniform(0.2, 0.6, (count, 2)), rng.uniform(-0.2, 0.2, (count, 2))
    turned = rng.uniform(-np.pi, np.pi, (count, 2))
    c, s = np.cos(poses[:, 2:]), np.sin(poses[:, 2:])
    x, y = poses[:, :1] + c * ahead_m - s * aside_m, poses[:, 1:2] + s * ahead_m + c * aside_m
    moving = np.stack((x, y, turned), axis=-1)
    moving[0], moving[1, 1] = np.nan, np.nan
    ray = RayCamera(FRAME, count, movers)
    for i in range(count):
        ray.set_robot(i, scene, NOMINAL.rig())
    reference = PyBulletCamera(scene, NOMINAL.rig(), FRAME, 3, movers)
    try:
        pictures, labels = ray.render(poses, None, moving), ray.segment(poses, moving)
        assert likeness(reference.render(poses, moving), pictures) > 0.95
        expected = reference.segment(poses, moving)
    finally:
        reference.close()
    assert np.mean(expected == labels) > 0.98
    for kind in (SemanticClass.PERSON, SemanticClass.VEHICLE):
        here, there = labels == kind, expected == kind
        assert (here & there).sum() > 0.9 * (here | there).sum() > 500
    bare = ray.render(poses, None, np.full_like(moving, np.nan))
    assert np.array_equal(bare[0], pictures[0])
    assert all((bare[i] != pictures[i]).any() for i in range(1, count))
    fewer = np.array([5, 2])
    assert np.array_equal(ray.render(poses[fewer], fewer, moving[fewer]), pictures[fewer])
