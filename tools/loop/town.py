"""What the bench simulates: the town, the robot's HAT, wheels and camera, the overhead camera."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from localizer_node.calibration import Calibration, Marker
from robot.computer.clock import Clock
from robot.geometry import Pose
from robot.navigation.road_map import RoadMap
from sim_pybullet.look import Look
from sim_pybullet.overhead import (
    Hanging,
    OverheadCamera,
    board_rgb,
    known_calibration,
    robot_sheets,
)
from sim_pybullet.virtual.hat import VirtualHat
from sim_pybullet.virtual.i2c import VirtualI2cBus
from sim_pybullet.virtual.world import PHYSICS_DT_S, VirtualWorld
from tools.loop.devices import BusServer
from tools.loop.picture_server import PictureServer
from tools.loop.timekeeper import Timekeeper

ROBOT = "robot"
CAMERA_FPS, OVERHEAD_FPS = 15, 10


class VirtualTown:
    """One robot in a town, with everything that a real one would have around it."""

    def __init__(
        self, road_map: RoadMap, look: Look, time: Timekeeper, folder: Path, seed: int
    ) -> None:
        rng = np.random.default_rng(seed)
        clock: Clock = time.clock
        self.bus = VirtualI2cBus()
        self.hat = VirtualHat(self.bus, clock)
        self.world = VirtualWorld(road_map, look, self.hat, clock, rng)
        self._marker, self._rng, self._clock = Marker(ROBOT), rng, clock
        self.moved_s = clock.now()  # when a motor last stepped
        self._fields = self.hat.fields_rad
        self._board = board_rgb(self._marker)
        ground = self.world.scene.ground
        size_m = (road_map.width_m, road_map.height_m)
        self._above = OverheadCamera(ground, _over(*size_m))
        self.calibration: Calibration = known_calibration(self._above, (self._marker,), size_m)
        self.bus_server = BusServer(folder / "i2c", self.bus, self._note_step)
        self.camera = PictureServer(folder / "camera", self.world.see, lambda: time.woken("robot"))
        self.overhead = PictureServer(
            folder / "overhead", self.see_above, lambda: time.woken("localizer")
        )
        for service in (self.bus_server, self.camera, self.overhead):
            time.add_service(service)
        time.every(PHYSICS_DT_S, self.world.follow)
        self.camera_event = time.every(1.0 / CAMERA_FPS, self.camera.moment)
        self.overhead_event = time.every(1.0 / OVERHEAD_FPS, self.overhead.moment)

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

    def see_above(self) -> np.ndarray:
        """The overhead camera's picture (720, 1280, 3) of now."""
        return self._above.render(robot_sheets(self._marker, self.pose, self._board), self._rng)

    def warm_up(self) -> None:
        """Draw what both cameras see once: the first time takes seconds, the next ones do not."""
        self.world.see()
        self.see_above()

    def close(self) -> None:
        """Hang up, and free the physics."""
        for service in (self.bus_server, self.camera, self.overhead):
            service.close()
        self.world.close()


def _over(width_m: float, height_m: float) -> Hanging:
    """As above the arena; over a larger map in its middle, so high that all of it is seen."""
    high_m = max(width_m, 0.45 * height_m)
    return Hanging() if high_m < 2.5 else Hanging((0.5 * width_m, 0.5 * height_m, high_m))
