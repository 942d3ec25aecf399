"""``RayCamera``: what many robots see, by reading the floor where each pixel's ray meets it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numba
import numpy as np

from robot.contract import ImageSpec
from robot.lens import CameraRig
from sim_pybullet.floor_kernel import FloorTables, FloorViews, draw_floor, label_floor
from sim_pybullet.look import SkyLook
from sim_pybullet.mip_texture import MipTexture, mip_texture
from sim_pybullet.rays import (
    LEVELS,
    FloorTable,
    PixelRays,
    floor_shade,
    floor_table,
    pixel_rays,
    sky_share,
)
from sim_pybullet.scene import Scene


class RayCamera:
    """Draws N robots' pictures in one call; keeps ``sim_pybullet.camera.Camera``.

    Every robot may have its own scene and rig; equal rigs share tables, robots that are given the
    same ``Scene`` object share its packed floor. A Scene must not be changed after it was given.
    """

    def __init__(self, image: ImageSpec, n_robots: int, threads: int | None = None) -> None:
        """``threads``: how many cores to use; None leaves numba's setting as it is."""
        self._image = image
        self._threads = threads
        height, width, _ = image.shape
        self._scenes: list[Scene | None] = [None] * n_robots
        self._textures: list[MipTexture | None] = [None] * n_robots
        self._skies = np.zeros((n_robots, height * width, 3), np.uint8)
        self._addresses = np.zeros(n_robots, np.int64)
        self._levels = np.zeros((n_robots, LEVELS, 3), np.int32)
        self._origins = np.zeros((n_robots, 3))  # west [m], north [m], texel [m]
        self._tables = _Tables(n_robots, height, width)

    @property
    def shape(self) -> tuple[int, int, int]:
        """(H, W, 3) of one picture."""
        return self._image.shape

    def set_robot(self, i: int, scene: Scene, rig: CameraRig) -> None:
        """Give robot ``i`` its world and its camera."""
        ground = scene.ground
        light = scene.light
        shade = floor_shade(light.ambient, light.diffuse, light.elevation_rad)
        texture = self._shared(scene) or mip_texture(ground, shade)
        rays = pixel_rays(rig, self._image)
        self._scenes[i] = scene
        self._textures[i] = texture
        self._skies[i] = _sky(rays, scene.sky)
        self._addresses[i] = texture.texels.ctypes.data
        self._levels[i] = texture.levels
        self._origins[i] = ground.west_m, ground.north_m, ground.texel_m
        self._tables.put(i, floor_table(rig, self._image, ground.texel_m))

    def render(self, poses: np.ndarray) -> np.ndarray:
        """(N, H, W, 3) uint8 RGB, before any sensor effect; poses (N, 3): x, y [m], heading."""
        pictures = np.empty((len(poses), *self._skies.shape[1:]), np.uint8)
        with self._using_threads() as threads:
            draw_floor(
                pictures,
                self._skies,
                self._views(poses),
                self._tables.arrays,
                max(1, -(-2 * threads // len(poses))),
            )
        return pictures.reshape(len(poses), *self.shape)

    def segment(self, poses: np.ndarray) -> np.ndarray:
        """(N, H, W) uint8, values of SemanticClass."""
        labels = np.zeros((len(poses), self._skies.shape[1]), np.uint8)
        with self._using_threads():
            label_floor(
                labels,
                self._views(poses),
                self._tables.arrays,
            )
        return labels.reshape(len(poses), *self.shape[:2])

    def _shared(self, scene: Scene) -> MipTexture | None:
        same = (t for s, t in zip(self._scenes, self._textures, strict=True) if s is scene)
        return next(same, None)

    def _views(self, poses: np.ndarray) -> FloorViews:
        poses = np.asarray(poses, dtype=np.float64)
        if poses.shape != (len(self._scenes), 3) or None in self._scenes:
            ready = sum(scene is not None for scene in self._scenes)
            raise ValueError(
                f"RayCamera: expected poses ({len(self._scenes)}, 3) and set_robot for each robot, "
                f"got poses {poses.shape} and {ready} robots set"
            )
        west, north, texel = self._origins.T
        x, y, heading = poses.T
        placed = np.stack(
            ((x - west) / texel, (north - y) / texel, np.cos(heading), np.sin(heading)), axis=-1
        )
        return FloorViews(placed, self._tables.slots, self._addresses, self._levels)

    @contextmanager
    def _using_threads(self) -> Iterator[int]:
        before = numba.get_num_threads()
        threads = self._threads or before
        numba.set_num_threads(threads)
        try:
            yield threads
        finally:
            numba.set_num_threads(before)


class _Tables:
    """The floor tables of all robots in stacked arrays; equal tables lie in one slot."""

    def __init__(self, n_robots: int, height: int, width: int) -> None:
        self._owners: list[FloorTable | None] = [None] * n_robots
        self.slots = np.zeros(n_robots, np.int64)
        self._stored: list[FloorTable | None] = [None]
        self._points = np.zeros((4, 1, height * width), np.float32)
        self._runs = np.zeros((1, 4 * height, 4), np.int32)
        self._first_run = np.zeros((1, height + 1), np.int32)

    @property
    def arrays(self) -> FloorTables:
        """All slots, as the kernels take them."""
        x, y, dx, dy = self._points
        return FloorTables(x, y, dx, dy, self._runs, self._first_run)

    def put(self, i: int, table: FloorTable) -> None:
        """Let robot ``i`` use this table."""
        self._owners[i] = table
        for slot, stored in enumerate(self._stored):
            if stored is table:
                self.slots[i] = slot
                return
        slot = self._free_slot()
        self._stored[slot] = table
        self.slots[i] = slot
        self._points[:, slot] = table.x, table.y, table.dx, table.dy
        if len(table.runs) > self._runs.shape[1]:
            self._runs = _grown(self._runs, 1, len(table.runs))
        self._runs[slot, : len(table.runs)] = table.runs
        self._first_run[slot] = table.first_run

    def _free_slot(self) -> int:
        used = {id(owner) for owner in self._owners}
        for slot, stored in enumerate(self._stored):
            if id(stored) not in used or stored is None:
                return slot
        count = min(2 * len(self._stored), len(self._owners))
        slot = len(self._stored)
        self._points = _grown(self._points, 1, count)
        self._runs = _grown(self._runs, 0, count)
        self._first_run = _grown(self._first_run, 0, count)
        self._stored += [None] * (count - slot)
        return slot


def _grown(array: np.ndarray, axis: int, length: int) -> np.ndarray:
    pad = [(0, 0)] * array.ndim
    pad[axis] = (0, length - array.shape[axis])
    return np.pad(array, pad)


def _sky(rays: PixelRays, sky: SkyLook) -> np.ndarray:
    """(P, 3) uint8: the sky's gradient; black where the lens has no such pixel."""
    share = sky_share(rays)[..., None]
    rgb = (1.0 - share) * np.array(sky.horizon_rgb) + share * np.array(sky.zenith_rgb)
    return np.round(np.where(rays.seen[..., None], rgb, 0.0)).astype(np.uint8).reshape(-1, 3)
