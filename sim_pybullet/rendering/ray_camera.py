"""``RayCamera``: what many robots see, by reading the floor where each pixel's ray meets it."""

from typing import Any, Protocol
from weakref import WeakKeyDictionary

import numba
import numpy as np

from robot.contract import ImageSpec
from robot.lens import CameraRig
from sim_pybullet.rendering import rays
from sim_pybullet.rendering.floor_kernel import FloorViews, draw_floor, label_floor
from sim_pybullet.rendering.mip_texture import mip_texture
from sim_pybullet.rendering.solid_geometry import light_row, place_movers, solid_rows
from sim_pybullet.rendering.solid_kernel import SolidViews, draw_solids
from sim_pybullet.scene import Mover, Scene

_ROWS: WeakKeyDictionary[Scene, np.ndarray] = WeakKeyDictionary()


class BatchCamera(Protocol):
    """`RayCamera` on the CPU, `torch_camera.TorchCamera` on a GPU, or none."""

    shape: tuple[int, int, int]  # (H, W, 3) of one picture
    device: str | None  # of torch, where pictures are tensors; None where they are arrays

    def set_robot(self, i: int, scene: Scene, rig: CameraRig) -> None:
        """Give robot ``i`` its world and its camera."""

    def render(
        self, poses: np.ndarray, robots: np.ndarray | None = None, movers: np.ndarray | None = None
    ) -> Any:
        """(N, H, W, 3) uint8 RGB, see `RayCamera.render`."""


class RigTables:
    """The tables of all robots' rigs in stacked arrays; robots with equal rigs share a slot."""

    def __init__(self, n_robots: int, image: ImageSpec) -> None:
        height, width, _ = image.shape
        self._image = image
        self.stored: list[rays.FloorTable | None] = [None] * n_robots  # what each slot holds
        self.slots = np.zeros(n_robots, np.int64)
        self.floor = rays.FloorTable(  # of all slots
            np.zeros((n_robots, 4, height * width), np.float32),
            np.zeros((n_robots, 4 * height, 4), np.int32),
            np.zeros((n_robots, height + 1), np.int32),
        )
        self.directions = np.zeros((n_robots, 3, height, width), np.float32)
        self.cells = np.zeros((n_robots, rays.AZIMUTHS, rays.ELEVATIONS, 4), np.int16)
        self.pixel_rad = np.zeros(n_robots)

    def put(self, i: int, rig: CameraRig, texel_m: float) -> None:
        """Let robot ``i`` see through this rig, over a floor of this texel size."""
        floor = rays.floor_table(rig, self._image, texel_m)
        for slot, stored in enumerate(self.stored):
            if stored is floor:
                self.slots[i] = slot
                return
        slot = min({*range(len(self.slots))} - {*np.delete(self.slots, i).tolist()})
        self.slots[i], self.stored[slot] = slot, floor
        self.floor = self.floor._replace(runs=_with_room(self.floor.runs, len(floor.runs)))
        self.floor.points[slot], self.floor.first_run[slot] = floor.points, floor.first_run
        self.floor.runs[slot, : len(floor.runs)] = floor.runs
        self.directions[slot] = np.moveaxis(rays.pixel_rays(rig, self._image).directions, -1, 0)
        self.cells[slot], self.pixel_rad[slot] = rays.direction_table(rig, self._image)


def _with_room(array: np.ndarray, length: int) -> np.ndarray:
    """An array (N, K, C) that has at least this length in its second axis."""
    missing = length - array.shape[1]
    return np.pad(array, ((0, 0), (0, missing), (0, 0))) if missing > 0 else array


class RayCamera:
    """Draws N robots' pictures in one call, in fresh arrays.

    Every robot may have its own scene and rig; equal rigs share tables, scenes with the same
    ``Ground`` and light its packed floor. Neither may be changed in place after it was given.
    ``movers`` are drawn in every scene, where each picture's poses of them say.
    """

    device: str | None = None  # its pictures are arrays

    def __init__(self, image: ImageSpec, n_robots: int, movers: tuple[Mover, ...] = ()) -> None:
        self._image = image
        height, width, _ = self.shape = image.shape
        self._scenes: list[Scene | None] = [None] * n_robots
        self._skies = np.zeros((n_robots, height * width * 3), np.uint8)
        self._sky_kinds = np.zeros((n_robots, height * width), np.uint8)
        self._addresses = np.zeros(n_robots, np.int64)
        self._levels = np.zeros((n_robots, rays.LEVELS, 3), np.int32)
        self._origins = np.zeros((n_robots, 3))  # west [m], north [m], texel [m]
        self._eyes = np.zeros((n_robots, 3))
        self._lights = np.zeros((n_robots, 5))
        self._tables = RigTables(n_robots, image)
        self._rows = np.zeros((n_robots, 0, 13))  # of the solids in each robot's scene
        self._counts = np.zeros(n_robots, np.int64)
        self._parts = solid_rows(tuple(solid for mover in movers for solid in mover))
        owners = [number for number, mover in enumerate(movers) for _ in mover]
        self._owners = np.array(owners, int)  # (D,) whose part each of the D rows is

    def set_robot(self, i: int, scene: Scene, rig: CameraRig) -> None:
        """Give robot ``i`` its world and its camera."""
        ground, light = scene.ground, scene.light
        texels, self._levels[i] = mip_texture(ground, rays.floor_shade(light))
        self._scenes[i] = scene
        if scene not in _ROWS:
            _ROWS[scene] = solid_rows(scene.solids)
        rows = _ROWS[scene]
        self._rows = _with_room(self._rows, len(rows) + len(self._parts))
        self._rows[i, : len(rows)], self._counts[i] = rows, len(rows)
        self._skies[i], self._sky_kinds[i] = rays.background(rig, self._image, scene)
        self._addresses[i] = texels.ctypes.data
        self._origins[i] = ground.west_m, ground.north_m, ground.texel_m
        self._eyes[i] = rig.mount.position_m
        self._lights[i] = light_row(light)
        self._tables.put(i, rig, ground.texel_m)

    def render(
        self, poses: np.ndarray, robots: np.ndarray | None = None, movers: np.ndarray | None = None
    ) -> np.ndarray:
        """(N, H, W, 3) uint8 RGB, before any sensor effect; poses (N, 3): x, y [m], heading.

        With ``robots``, indices of some of them, poses and pictures are only theirs. ``movers``
        (N, U, 3): poses of what moves around each, NaN where it is not there.
        """
        skies = self._skies if robots is None else self._skies[robots]
        poses, robots = self._checked(poses, robots)
        pictures = np.empty((len(poses), *self.shape), np.uint8)
        flat = pictures.reshape(len(poses), self._skies.shape[1])
        blocks = -(-2 * numba.get_num_threads() // max(1, len(poses)))
        draw_floor(flat, skies, self._floor_views(poses, robots), self._tables.floor, blocks)
        self._draw_solids(pictures, poses, robots, movers)
        return pictures

    def segment(self, poses: np.ndarray, movers: np.ndarray | None = None) -> np.ndarray:
        """(N, H, W) uint8, values of SemanticClass."""
        poses, robots = self._checked(poses)
        flat = self._sky_kinds.copy()
        label_floor(flat, self._floor_views(poses, robots), self._tables.floor)
        labels = flat.reshape(len(poses), *self.shape[:2])
        self._draw_solids(labels[..., None], poses, robots, movers)
        return labels

    def _checked(
        self, poses: np.ndarray, robots: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Poses and whose they are."""
        robots = np.arange(len(self._scenes)) if robots is None else np.asarray(robots)
        poses = np.ascontiguousarray(poses, dtype=np.float64)
        ready = sum(scene is not None for scene in self._scenes)
        if poses.shape != (len(robots), 3) or ready < len(self._scenes):
            raise ValueError(
                f"RayCamera: expected poses ({len(robots)}, 3) and set_robot for each robot, "
                f"got poses {poses.shape} and {ready} robots set"
            )
        return poses, robots

    def _floor_views(self, poses: np.ndarray, robots: np.ndarray) -> FloorViews:
        west, north, texel = self._origins[robots].T
        x, y, heading = poses.T
        placed = np.stack(
            ((x - west) / texel, (north - y) / texel, np.cos(heading), np.sin(heading)), axis=-1
        )
        slots = self._tables.slots[robots]
        return FloorViews(placed, slots, self._addresses[robots], self._levels[robots])

    def _draw_solids(
        self, pictures: np.ndarray, poses: np.ndarray, robots: np.ndarray, movers: np.ndarray | None
    ) -> None:
        views = self._solid_views(poses, robots, movers)
        if views is not None:
            draw_solids(pictures, views)

    def _solid_views(
        self, poses: np.ndarray, robots: np.ndarray, movers: np.ndarray | None
    ) -> SolidViews | None:
        """What stands around the robots; None where no world has solids."""
        if not self._rows.size:
            return None
        tables, first = self._tables, robots * self._rows.shape[1]
        rows, last = self._rows.reshape(-1, 13), first + self._counts[robots]
        if movers is not None:
            place_movers(rows, last, self._parts, self._owners, movers)
        eyes, lights, slots = (a[robots] for a in (self._eyes, self._lights, tables.slots))
        where = tables.directions, tables.cells, tables.pixel_rad
        return SolidViews(poses, eyes, lights, rows, first, last, slots, *where)


class NoCamera:
    """In the place of a `RayCamera` for who needs no pictures: black dots."""

    shape = (1, 1, 3)
    device: str | None = None

    def set_robot(self, i: int, scene: Scene, rig: CameraRig) -> None:
        """Nothing to do."""

    def render(self, poses: np.ndarray, *_: object) -> np.ndarray:
        """(M, 1, 1, 3) zeros."""
        return np.zeros((len(poses), *self.shape), np.uint8)
