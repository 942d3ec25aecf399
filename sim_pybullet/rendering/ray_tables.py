"""What ``RayCamera`` keeps per rig and per scene, in the arrays that its kernels read."""

from __future__ import annotations

from functools import partial

import numpy as np

from robot.contract import ImageSpec
from robot.lens import CameraRig
from sim_pybullet.rendering.floor_kernel import FloorTables
from sim_pybullet.rendering.rays import FloorTable, floor_table, pixel_rays
from sim_pybullet.rendering.solid_table import AZIMUTHS, ELEVATIONS, direction_table, solid_rows
from sim_pybullet.scene import Scene
from sim_pybullet.weak_cache import WeakCache


class RigTables:
    """The tables of all robots' rigs in stacked arrays; robots with equal rigs share a slot."""

    def __init__(self, n_robots: int, image: ImageSpec) -> None:
        height, width, _ = image.shape
        self._image = image
        self._wanted: list[FloorTable | None] = [None] * n_robots
        self._stored: list[FloorTable | None] = [None]
        self.slots = np.zeros(n_robots, np.int64)
        self._points = np.zeros((1, 4, height * width), np.float32)
        self._runs = np.zeros((1, 4 * height, 4), np.int32)
        self._first_run = np.zeros((1, height + 1), np.int32)
        self.directions = np.zeros((1, 3, height, width), np.float32)
        self.cells = np.zeros((1, AZIMUTHS, ELEVATIONS, 4), np.int16)
        self.pixel_rad = np.zeros(1)

    @property
    def floor(self) -> FloorTables:
        """The floor tables of all slots."""
        x, y, dx, dy = self._points.swapaxes(0, 1)
        return FloorTables(x, y, dx, dy, self._runs, self._first_run)

    def put(self, i: int, rig: CameraRig, texel_m: float) -> None:
        """Let robot ``i`` see through this rig, over a floor of this texel size."""
        floor = floor_table(rig, self._image, texel_m)
        self._wanted[i] = floor
        for slot, stored in enumerate(self._stored):
            if stored is floor:
                self.slots[i] = slot
                return
        slot = self._free_slot()
        self.slots[i] = slot
        self._stored[slot] = floor
        self._points[slot] = floor.x, floor.y, floor.dx, floor.dy
        if len(floor.runs) > self._runs.shape[1]:
            self._runs = _grown(self._runs, 1, len(floor.runs))
        self._runs[slot, : len(floor.runs)] = floor.runs
        self._first_run[slot] = floor.first_run
        self.directions[slot] = np.moveaxis(pixel_rays(rig, self._image).directions, -1, 0)
        table = direction_table(rig, self._image)
        self.cells[slot], self.pixel_rad[slot] = table

    def _free_slot(self) -> int:
        used = {id(table) for table in self._wanted}
        for slot, stored in enumerate(self._stored):
            if stored is None or id(stored) not in used:
                return slot
        slot, count = len(self._stored), min(2 * len(self._stored), len(self._wanted))
        for name, array in list(vars(self).items()):
            if isinstance(array, np.ndarray) and name != "slots":
                setattr(self, name, _grown(array, 0, count))
        self._stored += [None] * (count - slot)
        return slot


_ROWS: WeakCache[np.ndarray] = WeakCache()


class SolidRows:
    """The rows of the solids that N robots see: robot i sees rows first[i]..last[i]."""

    def __init__(self, n_robots: int) -> None:
        self._rows = np.zeros((n_robots, 0, 13))
        self._counts = np.zeros(n_robots, np.int64)

    def put(self, i: int, scene: Scene) -> None:
        """Robot ``i`` is in this scene, whose rows are kept as long as it lives."""
        rows = _ROWS.get(scene, None, partial(solid_rows, scene.solids))
        if len(rows) > self._rows.shape[1]:
            self._rows = _grown(self._rows, 1, len(rows))
        self._rows[i, : len(rows)], self._counts[i] = rows, len(rows)

    @property
    def rows(self) -> np.ndarray:
        """(K, 13), see `sim_pybullet.rendering.solid_table.solid_rows`."""
        return self._rows.reshape(-1, 13)

    @property
    def first(self) -> np.ndarray:
        """(N,) where the rows of each robot begin."""
        return np.arange(len(self._rows)) * self._rows.shape[1]

    @property
    def last(self) -> np.ndarray:
        """(N,) where they end."""
        return self.first + self._counts


def _grown(array: np.ndarray, axis: int, length: int) -> np.ndarray:
    pad = [(0, 0)] * array.ndim
    pad[axis] = (0, length - array.shape[axis])
    return np.pad(array, pad)
