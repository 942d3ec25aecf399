"""What the demonstration's robot is made of: wheels that obey exactly, an eye, a policy."""

from __future__ import annotations

import contextlib
import time

import numpy as np

from robot.camera.source import Frame
from robot.contract import (
    ACTION_TWISTS,
    DRIVE,
    PATH_ANGLE_LIMIT_RAD,
    PATH_POINTS,
    ImageSpec,
    PolicyContract,
)
from robot.geometry import Pose, WheelSpeeds
from robot.inference.preprocess import FRAME_SHAPE
from robot.navigation.guidance import FIRST_POINT_M, POINT_SPACING_M
from robot.navigation.road_map import RoadMap
from robot.safety.wheel_limits import STILL

LONGEST_S = 0.2  # of one move: a process that stalled must not leap
POINT = 2  # of the path input: 14 cm ahead
POINT_M = FIRST_POINT_M + POINT * POINT_SPACING_M
CURVATURES = np.array([twist.turn_radps / twist.forward_mps for twist in ACTION_TWISTS])


class PurePursuit:
    """A ``Policy`` that steers for a point ahead on its path (Coulter 1992), and never looks."""

    contract = PolicyContract("navigation", "pursuit", ImageSpec(), PATH_POINTS)

    def values(self, images: np.ndarray, path: np.ndarray | None = None) -> np.ndarray:  # noqa: ARG002
        """(N, actions), for paths (N, PATH_POINTS)."""
        assert path is not None  # the contract asks for one
        wanted = 2.0 * PATH_ANGLE_LIMIT_RAD * path[:, POINT] / POINT_M
        return np.asarray(-np.abs(CURVATURES - wanted[:, None]))


class ExactMotors:
    """``Motors`` whose ``pose`` is where the robot is."""

    def __init__(self, pose: Pose) -> None:
        self._pose, self._wheels, self._at_s = pose, STILL, time.monotonic()

    @property
    def pose(self) -> Pose:
        """Now."""
        before_s, self._at_s = self._at_s, time.monotonic()
        dt_s = min(self._at_s - before_s, LONGEST_S)
        twist = DRIVE.twist(self._wheels)
        self._pose = self._pose.moved(twist.forward_mps * dt_s, twist.turn_radps * dt_s)
        return self._pose

    def set_wheels(self, wheels: WheelSpeeds) -> None:
        """At once."""
        self._pose, self._wheels = self.pose, wheels

    def stop(self) -> None:
        """At once."""
        self.set_wheels(STILL)

    def release(self) -> None:
        """As ``stop``."""
        self.stop()

    def mend(self) -> None:
        """Nothing breaks."""


class DemoCamera:
    """A ``Camera`` at the robot's true pose; blotches, not shown, without the simulator."""

    def __init__(self, road_map: RoadMap, motors: ExactMotors, sees: bool) -> None:
        self._motors, self._rng, self._sequence = motors, np.random.default_rng(0), 0
        self.sees = False
        with contextlib.suppress(ImportError):
            if sees:
                self._open(road_map)

    def _open(self, road_map: RoadMap) -> None:
        from sim_pybullet.look import NOMINAL
        from sim_pybullet.rendering.ray_camera import RayCamera
        from sim_pybullet.scenery.objects import build_scene

        self._eye = RayCamera(ImageSpec(), 1)
        self._eye.set_robot(0, build_scene(road_map, NOMINAL, self._rng), NOMINAL.rig())
        self._eye.render(np.zeros((1, 3)))  # compiles, which may take half a minute once
        self.sees = True

    def read(self) -> Frame:
        """The picture of now."""
        self._sequence += 1
        if self.sees:
            picture = self._eye.render(np.array([self._motors.pose]))[0]
        else:
            picture = self._rng.integers(0, 256, FRAME_SHAPE, dtype=np.uint8)
        return Frame(picture, self._sequence, time.monotonic())
