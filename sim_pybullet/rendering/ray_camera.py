"""``RayCamera``: what many robots see, by reading the floor where each pixel's ray meets it."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numba
import numpy as np

from robot.contract import ImageSpec
from robot.lens import CameraRig
from sim_pybullet.rendering.floor_kernel import MipTexture, draw_floor, label_floor, mip_texture
from sim_pybullet.rendering.rays import Background, FloorTable, background, floor_shade, floor_table
from sim_pybullet.rendering.solid_kernel import draw_solids
from sim_pybullet.rendering.solid_table import (
    Directions,
    Solids,
    directions_of,
    light_row,
    mover_rows,
    solid_rows,
)
from sim_pybullet.scene import Ground, Mover, Scene

_ROWS: WeakKeyDictionary[Scene, np.ndarray] = WeakKeyDictionary()


class _View(NamedTuple):
    """What one robot looks at, and how."""

    ground: Ground
    behind: Background
    floor: FloorTable
    texture: MipTexture
    solids: Solids
    directions: Directions

    def placed(self, pose: np.ndarray) -> np.ndarray:
        """(4,) where a robot stands in the texture, see `draw_floor`."""
        (x, y, heading), ground = pose, self.ground
        column, row = (x - ground.west_m) / ground.texel_m, (ground.north_m - y) / ground.texel_m
        return np.array((column, row, np.cos(heading), np.sin(heading)))


class RayCamera:
    """Draws N robots' pictures in one call; keeps `sim_pybullet.rendering.camera.BatchCamera`.

    Every robot may have its own scene and rig; equal rigs share tables, scenes with the same
    ``Ground`` and light its packed floor. Neither may be changed in place after it was given.
    ``movers`` are drawn in every scene, where each picture's poses of them say.
    """

    def __init__(self, image: ImageSpec, n_robots: int, movers: tuple[Mover, ...] = ()) -> None:
        self._image = image
        self._views: list[_View | None] = [None] * n_robots
        self._away = np.full((len(movers), 3), np.nan)
        self._moving = mover_rows(movers)

    @property
    def shape(self) -> tuple[int, int, int]:
        """(H, W, 3) of one picture."""
        return self._image.shape

    def set_robot(self, i: int, scene: Scene, rig: CameraRig) -> None:
        """Give robot ``i`` its world and its camera."""
        if scene not in _ROWS:
            _ROWS[scene] = solid_rows(scene.solids)
        eye = np.array(rig.mount.position_m, dtype=np.float64)
        self._views[i] = _View(
            scene.ground,
            background(rig, self._image, scene),
            floor_table(rig, self._image, scene.ground.texel_m),
            mip_texture(scene.ground, floor_shade(scene.light)),
            Solids(_ROWS[scene], *self._moving, light_row(scene.light), eye),
            directions_of(rig, self._image),
        )

    def render(
        self,
        poses: np.ndarray,
        robots: np.ndarray | None = None,
        movers: np.ndarray | None = None,
    ) -> np.ndarray:
        """(N, H, W, 3) uint8 RGB, before any sensor effect; poses (N, 3): x, y [m], heading.

        With ``robots``, indices of some of them, poses and pictures are only theirs. ``movers``
        (N, U, 3): poses of what moves around each, NaN where it is not there.
        """

        def draw(picture: np.ndarray, view: _View, placed: np.ndarray) -> None:
            draw_floor(picture.ravel(), view.behind[0], placed, view.floor, view.texture)

        return self._each(draw, 3, poses, robots, movers)

    def segment(self, poses: np.ndarray, movers: np.ndarray | None = None) -> np.ndarray:
        """(N, H, W) uint8, values of SemanticClass."""

        def draw(labels: np.ndarray, view: _View, placed: np.ndarray) -> None:
            labels[:] = view.behind[1].reshape(labels.shape)
            label_floor(labels.ravel(), placed, view.floor, view.ground)

        return self._each(draw, 1, poses, None, movers)[..., 0]

    def _each(
        self,
        draw: Callable[[np.ndarray, _View, np.ndarray], None],
        channels: int,
        poses: np.ndarray,
        robots: np.ndarray | None,
        movers: np.ndarray | None,
    ) -> np.ndarray:
        """Pictures (N, H, W, channels): floors as ``draw`` has them, and what stands on them."""
        chosen = self._views if robots is None else [self._views[i] for i in robots.tolist()]
        views = [view for view in chosen if view is not None]
        poses = np.ascontiguousarray(poses, dtype=np.float64)
        if poses.shape != (len(views), 3) or len(views) < len(chosen):
            raise ValueError(
                f"RayCamera: expected poses ({len(chosen)}, 3) and set_robot for each robot, "
                f"got poses {poses.shape} and {len(views)} robots set"
            )
        pictures = np.empty((len(views), *self.shape[:2], channels), np.uint8)

        def work(some: np.ndarray) -> None:
            for k in some.tolist():
                draw(pictures[k], views[k], views[k].placed(poses[k]))
            for k in some.tolist():  # after all floors, or tables are read from far memory
                solids, around = views[k].solids, self._away if movers is None else movers[k]
                if len(solids.rows) or len(around):
                    draw_solids(pictures[k], solids, around, poses[k], views[k].directions)

        threads = min(numba.get_num_threads(), len(views))
        if threads <= 1:
            work(np.arange(len(views)))
        else:
            with ThreadPoolExecutor(threads) as pool:
                list(pool.map(work, np.array_split(np.arange(len(views)), threads)))
        return pictures
