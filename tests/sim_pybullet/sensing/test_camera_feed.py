"""Late and repeated pictures."""

from dataclasses import replace

import numpy as np
import pytest

from robot.contract import ImageSpec
from robot.lens import CameraRig
from sim_pybullet.look import NOMINAL, Look, SensorLook, TimingLook
from sim_pybullet.motors import PHYSICS_DT_S
from sim_pybullet.rendering.ray_camera import RayCamera
from sim_pybullet.scene import Ground, Scene
from sim_pybullet.sensing.camera_feed import CameraFeed
from tests.sim_pybullet.flat_camera import PoseCamera, shown_poses

FLOOR = np.zeros((8, 8), np.uint8)
SCENE = Scene(
    Ground(np.zeros((8, 8, 3), np.uint8), FLOOR, 0.1, 0.0, 0.8, (0, 0, 0)),
    (),
    NOMINAL.sky,
    NOMINAL.light,
)


def feed_of(*timings: TimingLook) -> CameraFeed:
    feed = CameraFeed(PoseCamera(len(timings)), len(timings))
    for i, timing in enumerate(timings):
        feed.begin(i, SCENE, replace(NOMINAL, timing=timing), np.array([float(i), 0.0, 3.0]))
    return feed


def test_pictures_are_as_late_as_the_look_says() -> None:
    rng = np.random.default_rng(0)
    feed = feed_of(TimingLook(), TimingLook(camera_delay_s=2.5 * PHYSICS_DT_S))
    for k in range(1, 8):
        feed.record(np.array([[0.3 * k, 0.0, 3.0], [1.0 + 0.3 * k, 0.0, 3.0 + 0.1 * k]]))
    late = shown_poses(feed.pictures(rng))
    assert late[0] == pytest.approx((2.1, 0.0, 3.0), abs=2e-3)
    assert late[1, 0] == pytest.approx(1.0 + 0.3 * 4.5, abs=2e-3)
    turned = (3.0 + 0.45 + np.pi) % (2 * np.pi) - np.pi  # across the jump from pi to -pi
    assert late[1, 2] == pytest.approx(turned, abs=2e-3)


def test_skipped_frames_repeat_the_last_one_but_never_the_last_episodes() -> None:
    rng = np.random.default_rng(0)
    feed = feed_of(TimingLook(frame_skip=1.0), TimingLook())
    first = shown_poses(feed.pictures(rng))
    feed.record(np.array([[0.5, 0.5, 0.0], [0.7, 0.7, 0.0]]))
    second = shown_poses(feed.pictures(rng))
    assert second[0] == pytest.approx(first[0])
    assert second[1] == pytest.approx((0.7, 0.7, 0.0))
    feed.begin(0, SCENE, Look(timing=TimingLook(frame_skip=1.0)), np.array([0.2, 0.1, 0.0]))
    assert shown_poses(feed.pictures(rng, np.array([0])))[0] == pytest.approx((0.2, 0.1, 0.0))


def test_a_share_of_frames_is_skipped() -> None:
    rng, repeats = np.random.default_rng(0), 0
    feed = feed_of(TimingLook(frame_skip=0.25))
    last = shown_poses(feed.pictures(rng))
    for k in range(1, 1001):
        feed.record(np.array([[0.001 * k, 0.0, 0.0]]))
        now = shown_poses(feed.pictures(rng))
        repeats += int(np.array_equal(now, last))
        last = now
    assert 0.2 < repeats / 1000 < 0.3


def test_the_sensor_is_that_of_the_robots_look() -> None:
    feed = CameraFeed(PoseCamera(2), 2)
    for i, exposure in enumerate((1.0, 0.5)):
        look = Look(sensor=SensorLook(exposure=exposure))
        feed.begin(i, SCENE, look, np.array([0.1, 0.2, 0.3]))
    bright, dim = feed.pictures(np.random.default_rng(0)).astype(int)
    assert np.abs(bright - 2 * dim).max() <= 1
    assert bright.max() > 0


def test_every_episode_has_the_camera_and_the_scene_of_its_own_look() -> None:
    camera, rng = PoseCamera(1), np.random.default_rng(0)
    feed = CameraFeed(camera, 1)
    other = replace(SCENE, sky=replace(SCENE.sky))
    for scene in (SCENE, SCENE, other, other, SCENE):
        for pitch_rad in rng.uniform(-0.1, 0.1, 3).tolist():
            look = replace(NOMINAL, camera=replace(NOMINAL.camera, pitch_rad=pitch_rad))
            feed.begin(0, scene, look, np.zeros(3))
            assert camera.rigs == [look.rig()]
            assert camera.scenes[0] is scene
        feed.begin(0, scene, look, np.zeros(3))
        assert camera.rigs == [look.rig()]


def test_the_lamp_in_the_floor_is_that_of_the_robots_look_and_heading() -> None:
    shining = replace(NOMINAL.light, azimuth_rad=0.0, elevation_rad=0.5, gloss=0.8)
    feed = CameraFeed(RayCamera(ImageSpec(), 3), 3)
    for i, light in enumerate((replace(shining, gloss=0.0), shining, shining)):
        heading_rad = 0.4 if i == 2 else 0.0
        scene = replace(SCENE, light=light)
        feed.begin(i, scene, NOMINAL, np.array([0.4, 0.4, heading_rad]))
    dull, ahead, right = feed.pictures(np.random.default_rng(0)).astype(int)
    columns = [(seen - dull)[..., 0].max(0).argmax() for seen in (ahead, right)]
    assert (ahead - dull).max() > 50
    assert (ahead - dull).min() >= 0
    assert columns[1] > columns[0] + 15  # the robot turned left: the lamp is to the right


def test_a_late_picture_shows_the_lamp_where_it_was() -> None:
    light = replace(NOMINAL.light, azimuth_rad=0.0, elevation_rad=0.5, gloss=0.8)
    feed, rng = CameraFeed(RayCamera(ImageSpec(), 1), 1), np.random.default_rng(0)
    late = replace(NOMINAL, timing=TimingLook(camera_delay_s=6 * PHYSICS_DT_S))
    feed.begin(0, replace(SCENE, light=light), late, np.array([0.4, 0.4, 0.0]))
    first = feed.pictures(rng)
    for _ in range(4):  # turns, and then stands
        feed.record(np.array([[0.4, 0.4, 0.4]]))
    np.testing.assert_array_equal(feed.pictures(rng), first)


def test_pictures_share_no_memory() -> None:
    rng = np.random.default_rng(0)
    feed = feed_of(TimingLook(frame_skip=0.5))
    first, second = feed.pictures(rng), feed.pictures(rng)
    assert not np.shares_memory(first, second)
    kept = second.copy()
    first[:] = 0
    second[:] = 0
    assert np.array_equal(feed.pictures(rng), kept)


class Negative:
    image = ImageSpec()

    def __call__(self, pictures: np.ndarray) -> np.ndarray:
        return 255 - pictures


def test_the_translator_sees_what_the_sensor_gives() -> None:
    look = Look(sensor=SensorLook(exposure=0.5))
    seen = []
    for translator in (None, Negative()):
        feed = CameraFeed(PoseCamera(1), 1, translator=translator)
        feed.begin(0, SCENE, look, np.array([0.1, 0.2, 0.3]))
        seen.append(feed.pictures(np.random.default_rng(0)))
    np.testing.assert_array_equal(seen[1], 255 - seen[0])


class PostCamera:
    """Sees one bright column, wherever it stands."""

    shape, device = (20, 160, 3), None

    def set_robot(self, i: int, scene: Scene, rig: CameraRig) -> None:
        """It sees no scene."""

    def render(self, poses: np.ndarray, robots: np.ndarray | None = None) -> np.ndarray:
        frames = np.zeros((len(poses), *self.shape), np.uint8)
        frames[:, :, 80] = 250
        return frames


@pytest.mark.parametrize("dt_s", [1 / 30, 1 / 60])
@pytest.mark.parametrize("turn_radps", [4.0, -2.0])
def test_a_smear_is_as_wide_as_the_robot_turns_while_the_shutter_is_open(
    dt_s: float, turn_radps: float
) -> None:
    """A turn by one radian moves a frame 160 px wide by 76 px."""
    look = Look(sensor=SensorLook(shutter_s=0.05))
    feed = CameraFeed(PostCamera(), 1, dt_s=dt_s)
    feed.begin(0, SCENE, look, np.array([0.0, 0.0, 3.0]))
    for k in range(1, 4):
        feed.record(np.array([[0.0, 0.0, 3.0 + turn_radps * dt_s * k]]))
    lit = feed.pictures(np.random.default_rng(0))[0, 10, :, 0] > 0
    assert lit.sum() == pytest.approx(0.05 * abs(turn_radps) * 76.0, abs=2.0)
    feed.begin(0, SCENE, look, np.array([0.0, 0.0, 3.0]))
    still = feed.pictures(np.random.default_rng(0))[0, 10, :, 0] > 0
    assert still.sum() == 1, "who begins stands still"


def test_a_picture_that_comes_again_is_the_last_that_came_not_the_last_that_was_taken() -> None:
    rng = np.random.default_rng(0)
    feed = feed_of(TimingLook(frame_skip=1.0), TimingLook(frame_skip=1.0))
    first, taken = shown_poses(feed.pictures(rng)), feed.shown.copy()
    assert feed.fresh.all()
    for k in range(1, 5):
        feed.record(np.array([[0.1 * k, 0.5, 0.0], [0.2 * k, 0.7, 0.0]]))
        np.testing.assert_array_equal(shown_poses(feed.pictures(rng)), first)
        np.testing.assert_array_equal(feed.shown, taken)
        assert not feed.fresh.any()
    second = shown_poses(feed.pictures(rng, np.array([1])))
    np.testing.assert_array_equal(second, first[1:])
