"""Effects of the camera, computed by hand for a few pictures."""

import math
from typing import Any

import cv2
import numpy as np
import pytest

from robot.contract import ImageSpec
from robot.lens import DUCKIEBOT_LENS, CameraRig, Mount
from sim_pybullet.look import ARENA_POSE, LightLook, Look, PoseLook, SensorLook
from sim_pybullet.rendering.rays import pixel_rays
from sim_pybullet.sensing.camera_feed import CameraFeed
from sim_pybullet.sensing.guidance_feed import GuidanceFeed, PoseError
from sim_pybullet.sensing.sensor import apply_sensor, smeared
from tests.sim_pybullet.sensing.gloss import add_gloss

PX_PER_RAD = 76.393  # of a frame 160 px wide: 305.57 px of a lens 640 px wide
POST = np.zeros((1, 20, 160, 3), np.uint8)
POST[:, :, 80] = 200


def rng() -> np.random.Generator:
    return np.random.default_rng(0)


def row(pictures: np.ndarray) -> np.ndarray:
    return pictures[0, 10, :, 0].astype(float)


def variance_px(pictures: np.ndarray) -> float:
    light, place = row(pictures), np.arange(pictures.shape[2])
    middle = (light * place).sum() / light.sum()
    return float((light * (place - middle) ** 2).sum() / light.sum())


def reddened(pictures: np.ndarray, *shares: float) -> np.ndarray:
    looks = [SensorLook(infrared=share) for share in shares]
    return apply_sensor(pictures, looks, np.random.default_rng(0))


@pytest.mark.parametrize(
    ("length_px", "seen"),
    [(3.0, [0, 67, 67, 67, 0]), (4.0, [25, 50, 50, 50, 25]), (2.0, [0, 50, 100, 50, 0])],
)
def test_a_smear_is_a_box_of_its_length(length_px: float, seen: list[int]) -> None:
    assert row(smeared(POST.copy(), np.array([length_px])))[78:83].tolist() == seen


def test_infrared_is_mixed_in_by_its_share() -> None:
    colour = np.array([[[[200, 40, 40]]]], np.uint8)  # its grey is 93.3
    assert reddened(colour, 0.5)[0, 0, 0].tolist() == [154, 60, 69]
    assert reddened(np.repeat(colour, 2, axis=0), 0.0, 1.0)[:, 0, 0].tolist() == [
        [200, 40, 40],
        [107, 79, 98],
    ]


def test_a_lamp_in_the_floor_is_phongs() -> None:
    light = LightLook(azimuth_rad=0.3, elevation_rad=0.5, gloss=0.8, gloss_width_rad=0.2)
    rig, image = CameraRig(DUCKIEBOT_LENS, Mount()), ImageSpec()
    frame = np.full((120, 160, 3), 50, np.uint8)
    add_gloss(frame, rig, image, light, 0.1)
    rays = pixel_rays(rig, image).directions
    flat = math.cos(0.5)
    lamp = np.array((flat * math.cos(0.2), flat * math.sin(0.2), -math.sin(0.5)))
    cosine = rays @ lamp / np.linalg.norm(rays, axis=-1)
    wanted = 50.0 + np.where(rays[..., 2] < 0, 160.0 * np.exp((cosine - 1.0) / 0.04), 0.0)
    assert np.abs(frame[..., 0] - wanted).max() <= 0.6
    assert frame.max() > 200


def test_a_lamp_does_not_overflow() -> None:
    light = LightLook(azimuth_rad=0.0, elevation_rad=0.5, gloss=0.8, gloss_width_rad=0.2)
    frame = np.full((120, 160, 3), 200, np.uint8)
    add_gloss(frame, CameraRig(DUCKIEBOT_LENS, Mount()), ImageSpec(), light, 0.0)
    assert frame.min() == 200
    assert frame.max() == 255


@pytest.mark.parametrize(("width_px", "variance"), [(160, 4.0), (80, 1.0)])
def test_blur_is_a_gaussian_of_its_width_on_a_frame_of_160_pixels(
    width_px: int, variance: float
) -> None:
    post = np.zeros((1, 20, width_px, 3), np.uint8)
    post[:, :, width_px // 2] = 255
    seen = apply_sensor(post, [SensorLook(blur_px=2.0)], rng())
    assert variance_px(seen) == pytest.approx(variance, rel=0.06)
    colour = np.zeros((1, 20, 160, 3), np.uint8)
    colour[..., 1] = 90
    np.testing.assert_array_equal(apply_sensor(colour, [SensorLook(blur_px=2.0)], rng()), colour)


def test_blur_goes_in_both_directions_alike() -> None:
    point = np.zeros((1, 41, 160, 3), np.uint8)
    point[0, 20, 80] = 255
    seen = apply_sensor(point, [SensorLook(blur_px=1.5)], rng())[0, ..., 0]
    patch = seen[10:31, 70:91]
    assert patch.sum() > 200
    np.testing.assert_array_equal(patch, patch.T)
    np.testing.assert_array_equal(patch, patch[::-1])
    np.testing.assert_array_equal(patch, patch[:, ::-1])


def test_edges_repeat_under_blur() -> None:
    left = np.zeros((1, 20, 160, 3), np.uint8)
    left[:, :, 0] = (90, 60, 30)
    seen = apply_sensor(left, [SensorLook(blur_px=1.0)], rng())[0, 10]
    share = 0.5 + 0.3989 / 2.0  # of the bell's middle and of all to its left
    np.testing.assert_allclose(seen[0], np.array((90, 60, 30)) * share, atol=1.5)


def test_a_shutter_of_a_small_picture_smears_half_as_many_pixels() -> None:
    look = SensorLook(shutter_s=0.1)
    for width_px, wanted in ((160, 0.2 * PX_PER_RAD), (80, 0.1 * PX_PER_RAD)):
        post = np.zeros((1, 20, width_px, 3), np.uint8)
        post[:, :, width_px // 2] = 250
        seen = row(apply_sensor(post, [look], rng(), turns_radps=np.array([2.0])))
        assert 250.0 / np.median(seen[seen > 0]) == pytest.approx(wanted, rel=0.05)


def test_vignetting_goes_by_the_square_of_the_distance_from_the_middle() -> None:
    grey = np.full((1, 120, 160, 3), 200, np.uint8)
    seen = apply_sensor(grey, [SensorLook(vignetting=0.5)], rng())[0, ..., 0].astype(float)
    corner = 79.5**2 + 59.5**2
    for y, x in ((0, 0), (0, 79), (60, 0), (30, 40), (119, 159)):
        distance = (y - 59.5) ** 2 + (x - 79.5) ** 2
        assert seen[y, x] == pytest.approx(200.0 * (1.0 - 0.5 * distance / corner), abs=0.6)


def test_a_large_picture_has_no_more_noise_than_the_sensor() -> None:
    grey = np.full((1, 240, 320, 3), 100, np.uint8)
    assert apply_sensor(grey, [SensorLook(noise=8.0)], rng()).std() == pytest.approx(8.0, rel=0.03)


def test_rows_of_noise_do_not_repeat_from_picture_to_picture() -> None:
    grey, source = np.full((1, 120, 160, 3), 100, np.uint8), rng()
    first, second = (apply_sensor(grey, [SensorLook(noise=8.0)], source) for _ in range(2))
    assert abs(np.corrcoef(first.ravel(), second.ravel())[0, 1]) < 0.02


def test_a_picture_is_compressed_as_jpeg_does_at_this_quality() -> None:
    picture = rng().integers(0, 256, (1, 24, 32, 3), dtype=np.uint8)
    picture[..., 2] //= 4  # so that red and blue are told apart
    for quality in (30, 90):
        seen = apply_sensor(picture, [SensorLook(jpeg_quality=quality)], rng())
        data = cv2.imencode(".jpg", picture[0, ..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
        np.testing.assert_array_equal(seen[0], cv2.imdecode(data, cv2.IMREAD_COLOR)[..., ::-1])


class Post:
    """A camera that always shows the post."""

    shape, device = (20, 160, 3), None

    def set_robot(self, *_: Any) -> None:
        pass

    def render(self, poses: np.ndarray, robots: np.ndarray | None = None) -> np.ndarray:
        return POST.repeat(len(poses), axis=0)


class Grey(Post):
    """A camera that shows one grey."""

    shape, level = (1, 1, 3), 0

    def render(self, poses: np.ndarray, robots: np.ndarray | None = None) -> np.ndarray:
        return np.full((len(poses), *self.shape), self.level, np.uint8)


SCENE: Any = type("Scene", (), {"light": LightLook()})()


@pytest.mark.parametrize("heading", [1.0, math.pi - 0.02, -math.pi + 0.001])
def test_robots_that_turn_smear_by_how_fast_they_turn(heading: float) -> None:
    """0.05 rad in the thirtieth part of a second, for the 0.1 s that the shutter is open."""
    feed = CameraFeed(Post(), 1)
    feed.begin(0, SCENE, Look(sensor=SensorLook(shutter_s=0.1)), np.array([0.0, 0.0, heading]))
    np.testing.assert_array_equal(feed.pictures(rng()), POST)  # it has stood
    turned = math.remainder(heading + 0.05, 2.0 * math.pi)
    feed.record(np.array([[0.0, 0.0, turned]]))
    seen = row(feed.pictures(rng()))
    assert 200.0 / np.median(seen[seen > 0]) == pytest.approx(0.1 * 1.5 * PX_PER_RAD, rel=0.1)
    feed.record(np.array([[0.0, 0.0, turned]]))
    np.testing.assert_array_equal(feed.pictures(rng()), POST)
    feed.begin(0, SCENE, Look(sensor=SensorLook(shutter_s=0.1)), np.array([0.0, 0.0, -2.0]))
    np.testing.assert_array_equal(feed.pictures(rng()), POST)


def test_the_newest_picture_of_a_stack_is_last() -> None:
    camera = Grey()
    feed = CameraFeed(camera, 2, frames=3)
    for i in range(2):
        feed.begin(i, SCENE, Look(), np.zeros(3))

    def see(level: int, robots: np.ndarray | None = None) -> list[list[int]]:
        camera.level = level
        return feed.pictures(rng(), robots)[:, 0, 0, ::3].tolist()

    assert see(7) == [[7, 7, 7]] * 2
    assert see(8) == [[7, 7, 8]] * 2
    assert see(9) == [[7, 8, 9]] * 2
    feed.begin(0, SCENE, Look(), np.zeros(3))
    assert see(1, np.array([0])) == [[1, 1, 1]]
    assert see(2) == [[1, 1, 2], [8, 9, 2]]


def test_outliers_are_off_by_up_to_a_metre_to_every_side() -> None:
    model, source = PoseError(500), rng()
    for robot in range(500):
        model.reset(robot, PoseLook(outlier=1.0), source)
    seen = model.observe(np.zeros((500, 3)), 0.0, source)[0]
    for side in (seen[:, 0], seen[:, 1], -seen[:, 0], -seen[:, 1]):
        assert 0.95 < side.max() <= 1.0
    np.testing.assert_array_equal(seen[:, 2], 0.0)


def test_a_gap_begins_so_often_and_lasts_up_to_its_longest() -> None:
    """Begun once in a second, gone for up to a second: 5.5 decisions without, after 10 with one."""
    look, source, missing = PoseLook(dropout_per_s=1.0, dropout_s=1.0), rng(), []
    model = PoseError(100)
    for robot in range(100):
        model.reset(robot, look, source)
    for tick in range(600):
        missing.append(np.isnan(model.observe(np.zeros((100, 3)), 0.1 * tick, source)[0][:, 0]))
    assert np.mean(missing) == pytest.approx(5.5 / 15.5, abs=0.015)
    assert ARENA_POSE.dropout_s == 1.0


def test_an_error_begins_as_large_as_it_stays_and_each_episode_with_another() -> None:
    look, source = PoseLook(position_m=0.03, heading_rad=0.1, correlation_s=5.0), rng()
    model = PoseError(400)
    for robot in range(400):
        model.reset(robot, look, source)
    standing = model.of_standing(np.zeros((400, 3)))
    np.testing.assert_allclose(standing.std(axis=0), [0.03, 0.03, 0.1], rtol=0.1)
    next_one = model.observe(np.zeros((400, 3)), 0.0, source)[0]
    kept = (standing * next_one).sum() / (standing**2).sum()
    assert kept == pytest.approx(math.exp(-0.1 / 5.0), abs=0.01)


def test_what_odometry_counted_before_an_episode_is_forgotten() -> None:
    """A robot is put down elsewhere while its wheels still turned: it believes what it is told."""
    feed, everyone = GuidanceFeed(1), np.array([0])
    look = PoseLook(position_m=1e-6, dropout_per_s=10.0, dropout_s=1e6)
    for place in (1.0, 2.0):
        pose = np.array([[place, place, 0.0]])
        feed.begin(everyone, [look], pose, np.zeros(1, dtype=int), [rng()])
        np.testing.assert_allclose(feed.poses, pose, atol=1e-4)
        feed.update(pose, rng())
        np.testing.assert_allclose(feed.poses, pose, atol=1e-4)
        feed.record(np.array([[0.3, 0.0]]))  # 1 cm straight on, in a thirtieth of a second
        feed.update(pose, rng())
        np.testing.assert_allclose(feed.poses, pose + np.array((0.01, 0.0, 0.0)), atol=5e-4)
        feed.record(np.array([[0.3, 2.0]]))  # booked on nobody: the next episode begins


def test_a_robot_knows_how_far_its_wheels_turned_it() -> None:
    feed = GuidanceFeed(1)
    pose = np.array([[1.0, 2.0, 0.5]])
    look = PoseLook(position_m=1e-6, dropout_per_s=10.0, dropout_s=1e6)
    feed.begin(np.array([0]), [look], pose, np.zeros(1, dtype=int), [rng()])
    for _ in range(3):
        feed.record(np.array([[0.0, 3.0]]))
    feed.update(pose, rng())
    np.testing.assert_allclose(feed.poses, [[1.0, 2.0, 0.8]], atol=2e-3)
