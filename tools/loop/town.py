"""What the bench simulates: a robot or two, a duck, and the camera above them."""

import math
from pathlib import Path

import numpy as np

from localizer_node.calibration import Board, Calibration, Marker
from robot.computer.clock import Clock
from robot.geometry import Pose
from robot.lens import Hanging
from robot.navigation.road_map import RoadMap
from sim_pybullet.look import Look
from sim_pybullet.overhead import OverheadCamera, Sheet, board_rgb, robot_sheets
from sim_pybullet.scene import Mover
from sim_pybullet.traffic.crowd import duck_solids, robot_solids
from sim_pybullet.virtual.hat import VirtualHat
from sim_pybullet.virtual.i2c import VirtualI2cBus
from sim_pybullet.virtual.world import PHYSICS_DT_S, VirtualWorld
from tools.loop.devices import BusServer, Listener, PictureServer
from tools.loop.timekeeper import Timekeeper

ROBOT, SECOND = "robot", "robot2"
DUCK = Marker("duck", front="orange", board=Board(0.1, 0.09, front_m=0.04))
CAMERA_FPS, OVERHEAD_FPS = 15, 10


class VirtualRobot:
    """One robot, with everything that a real one would have around it, but what hangs above."""

    def __init__(
        self,
        marker: Marker,
        road_map: RoadMap,
        look: Look,
        time: Timekeeper,
        folder: Path,
        seed: int,
        movers: tuple[Mover, ...] = (),
    ) -> None:
        clock: Clock = time.clock
        self.marker, self._rng, self._clock = marker, np.random.default_rng(seed), clock
        self.bus = VirtualI2cBus()
        self.hat = VirtualHat(self.bus, clock)
        self.world = VirtualWorld(road_map, look, self.hat, clock, self._rng, movers)
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


class VirtualTown(VirtualRobot):
    """One robot in a town under a camera; where asked for ``among`` a second robot and a duck."""

    def __init__(
        self,
        road_map: RoadMap,
        look: Look,
        time: Timekeeper,
        folder: Path,
        seed: int,
        among: bool = False,
    ) -> None:
        movers = (robot_solids("blue"), duck_solids()) if among else ()
        super().__init__(Marker(ROBOT), road_map, look, time, folder, seed, movers)
        self.second: VirtualRobot | None = None
        self.duck: Pose | None = None  # where it sits, with a board of its own
        markers = [self.marker]
        if among:
            other = Marker(SECOND, front="magenta")
            self.second = VirtualRobot(other, road_map, look, time, folder, seed + 1, movers)
            time.every(PHYSICS_DT_S, self._look_around)
            markers += [other, DUCK]
        size_m = (road_map.width_m, road_map.height_m)
        self._above = OverheadCamera(self.world.scene.ground, _over(*size_m))
        place = self._above.lens, self._above.hanging
        robots = tuple(markers)
        self.calibration = Calibration(*place, map_size_m=size_m, robots=robots, residual_mm=0.0)
        self.overhead = PictureServer(
            folder / "overhead", self.see_above, lambda: time.woken("localizer")
        )
        self.services.append(self.overhead)
        for service in (*self.services, *(self.second.services if self.second else ())):
            time.add_service(service)
        time.every(1.0 / OVERHEAD_FPS, self.overhead.moment)

    def _look_around(self) -> None:
        """Both robots' cameras see the other one, and the duck."""
        assert self.second is not None
        duck = self.duck or (math.nan, math.nan, math.nan)
        self.world.around[:] = self.second.pose, duck
        self.second.world.around[:] = self.pose, duck

    def see_above(self) -> np.ndarray:
        """The overhead camera's picture (720, 1280, 3) of now."""
        sheets = [*self.sheets, *(self.second.sheets if self.second else ())]
        if self.duck is not None:
            sheets += robot_sheets(DUCK, self.duck)[-1:]
        return self._above.render(sheets, self._rng)

    def close(self) -> None:
        """Hang up, and free the physics."""
        for robot in filter(None, (self, self.second)):
            for service in robot.services:
                service.close()
            robot.world.close()


def _over(width_m: float, height_m: float) -> Hanging:
    """As above the arena; over a larger map in its middle, so high that all of it is seen."""
    high_m = max(width_m, 0.45 * height_m)
    return Hanging() if high_m < 2.5 else Hanging((0.5 * width_m, 0.5 * height_m, high_m))
