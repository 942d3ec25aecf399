"""The demo robot's eye: the simulator's ray camera where it is installed."""

from __future__ import annotations

import time

import cv2
import numpy as np

from robot.contract import ImageSpec
from robot.geometry import Pose
from robot.link.messages import FrameMessage
from robot.link.telemetry import Attention
from robot.navigation.road_map import RoadMap

JPEG_QUALITY = 85
GRID_ROWS, GRID_COLUMNS = 12, 16
SPOT_CELLS = 1.6  # standard deviation of the spot


class DemoCamera:
    """Pictures of a road map as the policy would get them; ImportError without the simulator."""

    def __init__(self, road_map: RoadMap) -> None:
        from sim_pybullet.look import NOMINAL
        from sim_pybullet.rendering.ray_camera import RayCamera
        from sim_pybullet.scenery.objects import build_scene

        self._rig = NOMINAL.rig()
        self._camera = RayCamera(ImageSpec(), 1)
        scene = build_scene(road_map, NOMINAL, np.random.default_rng(0))
        self._camera.set_robot(0, scene, self._rig)
        self._camera.render(np.zeros((1, 3)))  # compiles, which may take half a minute once

    def frame(self, pose: Pose) -> FrameMessage:
        """The picture from a pose, as JPEG."""
        picture = self._camera.render(np.array([pose]))[0]
        quality = [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY]
        _, data = cv2.imencode(".jpg", cv2.cvtColor(picture, cv2.COLOR_RGB2BGR), quality)
        height, width, _ = picture.shape
        return FrameMessage(data.tobytes(), width, height, time.monotonic())

    def attention(self, pose: Pose, target_m: np.ndarray) -> Attention:
        """A spot round the place (2,) on the floor that the driver steers for."""
        ahead = np.append(pose.to_robot(target_m), 0.0)
        lens = self._rig.lens
        u, v = self._rig.to_pixels(ahead) / (lens.width_px, lens.height_px)
        rows, columns = np.mgrid[0:GRID_ROWS, 0:GRID_COLUMNS] + 0.5
        distance = np.hypot(rows - v * GRID_ROWS, columns - u * GRID_COLUMNS)
        return Attention.from_array(np.exp(-0.5 * (distance / SPOT_CELLS) ** 2))
