"""What ``RayCamera`` keeps per rig and per scene, in the arrays that its kernels read."""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

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


class SolidRows(NamedTuple):
    """The rows of all scenes' solids, each scene once; robot i sees rows first[i]..last[i]."""

    rows: np.ndarray
    first: np.ndarray
    last: np.ndarray


_ROWS: WeakCache[np.ndarray] = WeakCache()


def gather_solids(scenes: list[Scene]) -> SolidRows:
    """The solids of every robot's scene; the rows of each scene are kept as long as it lives."""
    spans: dict[int, tuple[int, int]] = {}
    tables: list[np.ndarray] = [np.empty((0, 13))]
    total = 0
    for scene in scenes:
        if id(scene) not in spans:
            spans[id(scene)] = (total, total + len(scene.solids))
            total += len(scene.solids)
            tables.append(_ROWS.get(scene, None, partial(solid_rows, scene.solids)))
    first = np.array([spans[id(scene)][0] for scene in scenes])
    last = np.array([spans[id(scene)][1] for scene in scenes])
    return SolidRows(np.concatenate(tables), first, last)


def _grown(array: np.ndarray, axis: int, length: int) -> np.ndarray:
    pad = [(0, 0)] * array.ndim
    pad[axis] = (0, length - array.shape[axis])
    return np.pad(array, pad)
