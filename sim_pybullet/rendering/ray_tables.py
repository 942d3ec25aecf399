"""What ``RayCamera`` keeps per rig, in the arrays that its kernels read."""

from __future__ import annotations

import numpy as np

from robot.contract import ImageSpec
from robot.lens import CameraRig
from sim_pybullet.rendering.rays import FloorTable, floor_table, pixel_rays
from sim_pybullet.rendering.solid_table import AZIMUTHS, ELEVATIONS, direction_table


class RigTables:
    """The tables of all robots' rigs in stacked arrays; robots with equal rigs share a slot."""

    def __init__(self, n_robots: int, image: ImageSpec) -> None:
        height, width, _ = image.shape
        self._image = image
        self._wanted: list[FloorTable | None] = [None] * n_robots
        self._stored: list[FloorTable | None] = [None] * n_robots
        self.slots = np.zeros(n_robots, np.int64)
        self._points = np.zeros((n_robots, 4, height * width), np.float32)
        self._runs = np.zeros((n_robots, 4 * height, 4), np.int32)
        self._first_run = np.zeros((n_robots, height + 1), np.int32)
        self.directions = np.zeros((n_robots, 3, height, width), np.float32)
        self.cells = np.zeros((n_robots, AZIMUTHS, ELEVATIONS, 4), np.int16)
        self.pixel_rad = np.zeros(n_robots)

    @property
    def floor(self) -> FloorTable:
        """The floor tables of all slots."""
        x, y, dx, dy = self._points.swapaxes(0, 1)
        return FloorTable(x, y, dx, dy, self._runs, self._first_run)

    def put(self, i: int, rig: CameraRig, texel_m: float) -> None:
        """Let robot ``i`` see through this rig, over a floor of this texel size."""
        floor = floor_table(rig, self._image, texel_m)
        self._wanted[i] = floor
        for slot, stored in enumerate(self._stored):
            if stored is floor:
                self.slots[i] = slot
                return
        used = {id(table) for table in self._wanted if table is not None}
        slot = next(k for k, stored in enumerate(self._stored) if id(stored) not in used)
        self.slots[i] = slot
        self._stored[slot] = floor
        self._points[slot] = floor.x, floor.y, floor.dx, floor.dy
        self._runs = with_room(self._runs, len(floor.runs))
        self._runs[slot, : len(floor.runs)] = floor.runs
        self._first_run[slot] = floor.first_run
        self.directions[slot] = np.moveaxis(pixel_rays(rig, self._image).directions, -1, 0)
        self.cells[slot], self.pixel_rad[slot] = direction_table(rig, self._image)


def with_room(array: np.ndarray, length: int) -> np.ndarray:
    """An array (N, K, ...) that has at least this length in its second axis."""
    missing = max(0, length - array.shape[1])
    pad = [(0, missing) if axis == 1 else (0, 0) for axis in range(array.ndim)]
    return np.pad(array, pad) if missing else array
