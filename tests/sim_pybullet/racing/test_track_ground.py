"""What is painted and built along a track, and that both cameras see it alike."""

from dataclasses import replace

import numpy as np
import pytest
from skimage.metrics import structural_similarity

from robot.contract import CONTROL_DT_S, ImageSpec
from sim_pybullet.look import NOMINAL, GroundLook, Look, TrackLook
from sim_pybullet.racing.track import SCALE, centre_line, load_track
from sim_pybullet.racing.track_ground import STONE_M, paint_track, track_walls
from sim_pybullet.randomise import load_look_sampler, load_looks, shipped_looks
from sim_pybullet.rendering.ray_camera import RayCamera
from sim_pybullet.scene import Ground, SemanticClass
from sim_pybullet.scenery.objects import build_scene
from sim_pybullet.tasks.track_racing import TOP_SPEED_MPS
from tests.sim_pybullet.pybullet_camera import PyBulletCamera

TRACK = load_track("karting")
LINE = centre_line(TRACK)
PLAIN = Look(ground=GroundLook(grain=0.0))


def classes_beside(ground: Ground, offset_m: float) -> np.ndarray:
    """The classes (M,) at the points that lie so far to the left of the centre line."""
    headings = LINE.path.headings_rad
    points = LINE.path.points_m + offset_m * np.stack((-np.sin(headings), np.cos(headings)), 1)
    columns = (points[:, 0] / ground.texel_m).astype(int)
    rows = ((ground.north_m - points[:, 1]) / ground.texel_m).astype(int)
    return ground.classes[rows, columns]


@pytest.mark.parametrize("period_m", [5.0, 10.0])
def test_dashes_come_as_often_as_the_look_says(period_m: float) -> None:
    look = replace(PLAIN, track=replace(PLAIN.track, dashes_m=period_m))
    yellow = classes_beside(paint_track(TRACK, look), 0.0) == SemanticClass.YELLOW_LINE
    begun = np.sum(yellow & ~np.roll(yellow, 1))
    assert begun == pytest.approx(LINE.path.length_m / SCALE / period_m, abs=1.5)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_from_the_middle_outwards_come_road_line_kerb_and_grass(side: float) -> None:
    ground = paint_track(TRACK, PLAIN)
    half = side * LINE.half_width_m
    assert np.isin(classes_beside(ground, 0.5 * half), (SemanticClass.ROAD, 3)).all()
    middle = classes_beside(ground, 0.0)
    assert 0.35 < np.mean(middle == SemanticClass.YELLOW_LINE) < 0.65
    edge = classes_beside(ground, half - side * 0.35 * SCALE)
    assert np.mean(edge == SemanticClass.WHITE_LINE) > 0.95
    kerb = classes_beside(ground, half + side * 0.5 * SCALE) == SemanticClass.KERB
    bends = np.abs(LINE.curvature) > 0.0
    assert kerb[bends].mean() > 0.98
    assert kerb.mean() < 1.0
    grass = classes_beside(ground, half + side * 2.0 * SCALE)
    assert (grass == SemanticClass.OUTSIDE).all()


def test_the_same_look_paints_the_same_ground_and_others_differ() -> None:
    first, again = paint_track(TRACK, NOMINAL), paint_track(TRACK, NOMINAL)
    assert np.array_equal(first.rgb, again.rgb)
    dim = replace(NOMINAL, ground=replace(NOMINAL.ground, patchiness=0.5, brightness=0.6))
    assert paint_track(TRACK, dim).rgb.mean() < 0.8 * first.rgb.mean()


def test_the_fastest_car_sees_each_period_of_the_road_four_times() -> None:
    fastest_m = TOP_SPEED_MPS * CONTROL_DT_S
    assert min(TrackLook().dashes_m, 2.0 * STONE_M) >= 4.0 * fastest_m


def test_walls_stand_at_the_edge_of_the_grass_and_on_no_road() -> None:
    walls = track_walls(TRACK, NOMINAL)
    at = np.array([(wall.x_m, wall.y_m) for wall in walls])
    away = np.array([np.hypot(*(LINE.path.points_m - p).T).min() for p in at])
    limit = LINE.half_width_m + LINE.verge_m
    assert (away > limit - 0.4 * SCALE).all()
    assert (away < limit + 0.7 * SCALE).all()
    built = sum(wall.size_m[0] for wall in walls)
    assert built > 0.9 * 2.0 * LINE.path.length_m
    assert {wall.kind for wall in walls} == {SemanticClass.WALL}


def test_both_cameras_draw_the_same_track() -> None:
    scene = build_scene(
        TRACK, load_look_sampler("tracks/city")(np.random.default_rng(0)), np.random.default_rng(0)
    )
    spec, count = ImageSpec(160, 120), 4
    ways = LINE.path.length_m * np.arange(count) / count
    poses = np.array([LINE.path.pose_at(float(way)) for way in ways])
    ray, reference = RayCamera(spec, count), PyBulletCamera(scene, NOMINAL.rig(), spec, 3)
    for i in range(count):
        ray.set_robot(i, scene, NOMINAL.rig())
    pairs = zip(ray.render(poses), reference.render(poses), strict=True)
    assert np.mean([structural_similarity(a, b, channel_axis=-1) for a, b in pairs]) > 0.95
    labels = ray.segment(poses)
    assert np.mean(labels == reference.segment(poses)) > 0.98
    reference.close()
    seen = set(np.unique(labels).tolist())
    kinds = ("SKY", "OUTSIDE", "ROAD", "WHITE_LINE", "YELLOW_LINE", "KERB", "WALL")
    assert {int(SemanticClass[kind]) for kind in kinds} <= seen


def test_ten_looks_of_tracks_differ_from_each_other() -> None:
    looks = load_looks("tracks")
    assert isinstance(looks, list)
    assert len(looks) >= 10
    assert {"tracks", "tracks/dusk", "nominal", "randomised"} <= set(shipped_looks())
    means = np.array([(*look.ground.asphalt_rgb, *look.track.grass_rgb) for look in looks])
    apart = np.abs(means[:, None] - means[None]).max(axis=-1) + 255.0 * np.eye(len(looks))
    assert apart.min() > 10.0
