"""What the bench simulates: one robot or two in a town, a duck, and the overhead camera."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from localizer_node.calibration import Board, Calibration, Marker
from robot.geometry import Pose
from robot.lens import Hanging
from robot.navigation.road_map import RoadMap
from sim_pybullet.look import Look
from sim_pybullet.overhead import OverheadCamera, known_calibration, robot_sheets
from tools.loop.picture_server import PictureServer
from tools.loop.timekeeper import Timekeeper
from tools.loop.virtual_robot import VirtualRobot

ROBOT, SECOND = "robot", "robot2"
DUCK = Marker("duck", front="orange", board=Board(0.1, 0.09, front_m=0.04))
OVERHEAD_FPS = 10


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
        super().__init__(Marker(ROBOT), road_map, look, time, folder, seed)
        self.second: VirtualRobot | None = None
        self.duck: Pose | None = None  # where it sits, with a board of its own
        markers = [self.marker]
        if among:
            other = Marker(SECOND, front="magenta")
            self.second = VirtualRobot(other, road_map, look, time, folder, seed + 1)
            markers += [other, DUCK]
        size_m = (road_map.width_m, road_map.height_m)
        self._above = OverheadCamera(self.world.scene.ground, _over(*size_m))
        self.calibration: Calibration = known_calibration(self._above, tuple(markers), size_m)
        self.overhead = PictureServer(
            folder / "overhead", self.see_above, lambda: time.woken("localizer")
        )
        self.services.append(self.overhead)
        for service in (*self.services, *(self.second.services if self.second else ())):
            time.add_service(service)
        self.overhead_event = time.every(1.0 / OVERHEAD_FPS, self.overhead.moment)

    def see_above(self) -> np.ndarray:
        """The overhead camera's picture (720, 1280, 3) of now."""
        sheets = [*self.sheets, *(self.second.sheets if self.second else ())]
        if self.duck is not None:
            sheets += robot_sheets(DUCK, self.duck)[-1:]
        return self._above.render(sheets, self._rng)

    def warm_up(self) -> None:
        """Draw what both cameras see once: the first time takes seconds, the next ones do not."""
        self.world.see()
        self.see_above()

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
