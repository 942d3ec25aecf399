"""A robot of the bench: HAT, wheels and camera."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from localizer_node.calibration import Marker
from robot.computer.clock import Clock
from robot.geometry import Pose
from robot.navigation.road_map import RoadMap
from sim_pybullet.look import Look
from sim_pybullet.overhead import Sheet, board_rgb, robot_sheets
from sim_pybullet.virtual.hat import VirtualHat
from sim_pybullet.virtual.i2c import VirtualI2cBus
from sim_pybullet.virtual.world import PHYSICS_DT_S, VirtualWorld
from tools.loop.devices import BusServer, Listener
from tools.loop.picture_server import PictureServer
from tools.loop.timekeeper import Timekeeper

CAMERA_FPS = 15


class VirtualRobot:
    """One robot, with everything that a real one would have around it, but what hangs above.

    Its camera does not see other robots.
    """

    def __init__(
        self,
        marker: Marker,
        road_map: RoadMap,
        look: Look,
        time: Timekeeper,
        folder: Path,
        seed: int,
    ) -> None:
        clock: Clock = time.clock
        self.marker, self._rng, self._clock = marker, np.random.default_rng(seed), clock
        self.bus = VirtualI2cBus()
        self.hat = VirtualHat(self.bus, clock)
        self.world = VirtualWorld(road_map, look, self.hat, clock, self._rng)
        self.moved_s = clock.now()  # when a motor last stepped
        self._fields = self.hat.fields_rad
        name, self._board = marker.robot, board_rgb(marker)
        self.bus_server = BusServer(folder / f"{name}-i2c", self.bus, self._note_step)
        see = self.world.see
        self.camera = PictureServer(folder / f"{name}-camera", see, lambda: time.woken(name))
        self.services: list[Listener] = [self.bus_server, self.camera]
        time.every(PHYSICS_DT_S, self.world.follow)
        self.camera_event = time.every(1.0 / CAMERA_FPS, self.camera.moment)

    def _note_step(self) -> None:
        """Remember when a field last turned: that is a step of a motor."""
        fields = self.hat.fields_rad
        turned = zip(fields, self._fields, strict=True)
        if any(a is not None and b is not None and a != b for a, b in turned):
            self.moved_s = self._clock.now()
        self._fields = fields

    @property
    def pose(self) -> Pose:
        """Where the robot truly is."""
        return self.world.pose

    @property
    def sheets(self) -> list[Sheet]:
        """What is seen of it from above."""
        return robot_sheets(self.marker, self.pose, self._board)
