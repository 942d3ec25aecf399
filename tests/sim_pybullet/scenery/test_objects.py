import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robot.contract import ImageSpec
from robot.geometry import Pose
from robot.lens import DUCKIEBOT_LENS, CameraRig
from robot.navigation.map_objects import MapObject, kinds, objects_of
from robot.navigation.road_map import load_map
from sim_pybullet.look import NOMINAL, LightLook, SkyLook
from sim_pybullet.rendering.ray_camera import RayCamera
from sim_pybullet.scene import Ground, Scene, SemanticClass, Solid
from sim_pybullet.scenery.object_solids import object_solids
from sim_pybullet.scenery.objects import build_scene

IMAGE = ImageSpec(160, 120)
RIG = CameraRig(DUCKIEBOT_LENS.scaled(160, 120))
ORIGIN = Pose(0.0, 0.0, 0.0)
GREY = Ground(
    np.full((64, 64, 3), 60, np.uint8),
    np.full((64, 64), SemanticClass.ROAD, np.uint8),
    0.1,
    -3.2,
    3.2,
    (60.0, 60.0, 60.0),
)


def look_at(*solids: Solid, pose: Pose = ORIGIN) -> tuple[np.ndarray, np.ndarray]:
    camera = RayCamera(IMAGE, 1)
    camera.set_robot(0, Scene(GREY, solids, SkyLook(), LightLook()), CameraRig(DUCKIEBOT_LENS))
    poses = np.array([pose])
    return camera.render(poses)[0], camera.segment(poses)[0]


def covered(labels: np.ndarray) -> np.ndarray:
    return np.argwhere(labels == SemanticClass.OBJECT)[:, ::-1]


@settings(max_examples=40, deadline=None)
@given(
    st.sampled_from(["box", "cylinder"]),
    st.floats(0.25, 1.5),
    st.floats(-0.7, 0.7),
    st.floats(-3.0, 3.0),
    st.floats(0.0, 0.1),
)
def test_a_small_solid_is_seen_where_the_lens_projects_it(
    shape: str, distance: float, bearing: float, heading: float, base: float
) -> None:
    pose = Pose(0.4, -0.2, 1.1)
    ahead, left = distance * math.cos(bearing), distance * math.sin(bearing)
    x, y = pose.to_world(np.array([0.066 + ahead, left]))
    solid = Solid(shape, x, y, heading, (0.04, 0.04, 0.04), (200, 0, 0), base_m=base)  # type: ignore[arg-type]
    expected = RIG.to_pixels(np.array([0.066 + ahead, left, base + 0.02]))
    _, labels = look_at(solid, pose=pose)
    if (expected > 6).all() and (expected < (153, 113)).all():
        assert np.abs(covered(labels).mean(axis=0) - expected).max() < 1.5


@settings(max_examples=25, deadline=None)
@given(st.floats(-0.6, 0.6), st.floats(0.3, 1.2), st.floats(-3.0, 3.0), st.floats(0.05, 0.3))
def test_the_search_box_loses_no_pixel(
    bearing: float, distance: float, heading: float, size: float
) -> None:
    """A box hides its own corners' neighbourhood: its outline reaches each visible corner."""
    x, y = 0.066 + distance * math.cos(bearing), distance * math.sin(bearing)
    solid = Solid("box", x, y, heading, (size, 0.1, 0.2), (200, 0, 0))
    c, s = math.cos(heading), math.sin(heading)
    corners = np.array([[a * size / 2, b * 0.05] for a in (-1, 1) for b in (-1, 1)])
    corners = corners @ np.array([[c, s], [-s, c]]) + (x, y)
    if np.hypot(corners[:, 0] - 0.066, corners[:, 1]).min() < 0.05:
        return
    _, labels = look_at(solid)
    tops = RIG.to_pixels(np.column_stack((corners, np.full(4, 0.2))))
    pixels = covered(labels)
    for corner in tops:
        if (corner > 1).all() and (corner < (158, 118)).all():
            assert np.abs(pixels - corner).max(axis=1).min() < 1.6


def test_the_nearer_solid_hides_the_farther_one_whatever_their_order() -> None:
    near = Solid("box", 0.4, 0.0, 0.0, (0.05, 0.2, 0.3), (250, 0, 0), SemanticClass.SIGN)
    far = Solid("cylinder", 0.8, 0.0, 0.0, (0.1, 0.1, 0.25), (0, 0, 250), SemanticClass.VEHICLE)
    frames = [look_at(*order) for order in ((near, far), (far, near))]
    assert np.array_equal(frames[0][0], frames[1][0])
    assert np.array_equal(frames[0][1], frames[1][1])
    assert SemanticClass.VEHICLE not in frames[0][1]


def test_faces_are_lit_by_lambert() -> None:
    light = LightLook(azimuth_rad=math.pi, elevation_rad=0.0, ambient=0.5, diffuse=0.5)
    box = Solid("box", 0.5, 0.0, 0.0, (0.1, 0.2, 0.2), (200, 100, 50))
    camera = RayCamera(IMAGE, 1)
    for azimuth, shade in ((math.pi, 1.0), (0.0, 0.5), (math.pi - math.pi / 3, 0.75)):
        scene = Scene(GREY, (box,), SkyLook(), replace(light, azimuth_rad=azimuth))
        camera.set_robot(0, scene, CameraRig(DUCKIEBOT_LENS))
        frame = camera.render(np.zeros((1, 3)))[0]
        u, v = np.round(RIG.to_pixels(np.array([0.45, 0.0, 0.12]))).astype(int)
        assert np.abs(frame[v, u] - shade * np.array([200, 100, 50])).max() <= 1.0


@pytest.mark.parametrize("kind", sorted(kinds()))
def test_every_kind_of_object_stands_on_the_floor_and_is_as_high_as_asked(kind: str) -> None:
    solids = object_solids(MapObject("it", kind, 1.0, 2.0, 0.7, 0.2))
    if kind == "floor_tag":
        assert not solids
        return
    assert min(solid.base_m for solid in solids) == 0.0
    assert max(solid.base_m + solid.size_m[2] for solid in solids) == pytest.approx(0.2, abs=0.011)
    # nobody collides with a traffic light: maps put them into the way, as if they hung there
    assert any(solid.collides for solid in solids) == (kind != "trafficlight")
    assert all(min(solid.size_m) > 0.0 for solid in solids)


def test_optional_objects_come_and_go_with_the_generator() -> None:
    town = load_map("town")
    counts = {
        len(build_scene(town, NOMINAL, np.random.default_rng(seed)).solids) for seed in range(4)
    }
    assert len(counts) > 1
    certain = [o for o in objects_of(town) if not o.optional]
    assert min(counts) >= sum(len(object_solids(item)) for item in certain)


def test_objects_of_the_reference_maps_are_all_known(data_dir: Path) -> None:
    for path in sorted((data_dir / "maps").glob("*/*.yaml")):
        for item in objects_of(load_map(path)):
            object_solids(item)
