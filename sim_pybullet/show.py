"""What robots see on a map or track in draws of a look, and where they drive, as in examples."""

import cv2
import numpy as np

from robot.contract import ImageSpec
from robot.navigation.road_map import RoadMap
from sim_pybullet.look import GroundLook
from sim_pybullet.painting.ground import paint_ground
from sim_pybullet.randomise import Sampler
from sim_pybullet.rendering.ray_camera import RayCamera
from sim_pybullet.scenery.objects import Place, build_scene, lane_poses
from sim_pybullet.sensing.camera_feed import CameraFeed

_TURN_RAD = 0.05  # in the last physics step: a robot that turns smears its picture
_GAP_PX = 2
_WAY_RGB = (0, 160, 255)


def draws(place: Place, sample: Sampler, count: int, rng: np.random.Generator) -> np.ndarray:
    """(count, 120, 160, 3) uint8 RGB: a robot on the lane in each of so many draws of a look."""
    feed = CameraFeed(RayCamera(ImageSpec(), count), count)
    poses = lane_poses(place, count, rng)
    for i, pose in enumerate(poses):
        look = sample(rng)
        feed.begin(i, build_scene(place, look, rng), look, pose)
    feed.record(poses + (0.0, 0.0, 1.0) * rng.uniform(-_TURN_RAD, _TURN_RAD, (count, 1)))
    return feed.pictures(rng)


def from_above(road_map: RoadMap, points_m: np.ndarray) -> np.ndarray:
    """The floor of a map, and a way over it through points (K, 2), (H, W, 3) uint8 RGB."""
    ground = paint_ground(road_map, GroundLook())
    picture = ground.rgb.copy()
    pixels = (points_m - (ground.west_m, ground.north_m)) * (1.0, -1.0) / ground.texel_m
    cv2.polylines(picture, [pixels.round().astype(np.int32)], False, _WAY_RGB, 8, cv2.LINE_AA)
    return picture


def sheet(pictures: np.ndarray, columns: int = 4) -> np.ndarray:
    """The pictures in rows, with white lines between, (H, W, 3) uint8 RGB."""
    rows = -(-len(pictures) // columns)
    framed = np.pad(
        pictures, ((0, rows * columns - len(pictures)), (0, _GAP_PX), (0, _GAP_PX), (0, 0)),
        constant_values=255,
    )  # fmt: skip
    height, width = framed.shape[1:3]
    grid = framed.reshape(rows, columns, height, width, 3).swapaxes(1, 2)
    return np.asarray(grid.reshape(rows * height, columns * width, 3))
