"""``PyBulletCamera``: the reference renderer, PyBullet's own picture warped to the lens."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from robot.contract import ImageSpec
from robot.geometry import Pose
from robot.lens import CameraRig
from sim_pybullet.bullet import Drawing, Stage
from sim_pybullet.classes import SemanticClass
from sim_pybullet.look import LightLook
from sim_pybullet.rendering.pinhole_cover import PinholeView, cover
from sim_pybullet.rendering.rays import pixel_rays, sky_rgb
from sim_pybullet.rendering.solid_mesh import floor_mesh, outside_mesh, solid_mesh
from sim_pybullet.rendering.solid_table import light_row
from sim_pybullet.scene import Mover, Scene, Solid

_LABEL_STEP = 20  # grey levels between two classes in the floor's class texture
_AWAY_M = (0.0, 0.0, -1000.0)


class PyBulletCamera:
    """Draws one scene through one rig, robot after robot.

    PyBullet draws pinhole views that cover the whole lens, ``oversample`` times as fine as the
    picture; each pixel then averages the views where its exact rays meet them.
    """

    def __init__(
        self,
        scene: Scene,
        rig: CameraRig,
        image: ImageSpec,
        oversample: int = 2,
        movers: tuple[Mover, ...] = (),
    ) -> None:
        self._scene, self._rig, self._image = scene, rig, image
        self.cover = cover(rig, image, oversample)
        self._skies = [sky_rgb(view.directions(), scene.sky) for view in self.cover.views]
        self._stage = Stage()
        ground = scene.ground
        self._floor = self._stage.add(floor_mesh(ground))
        self._stage.texture(self._floor, ground.rgb)
        self._labels = self._stage.add(floor_mesh(ground))
        self._stage.texture(
            self._labels, np.repeat(ground.classes[..., None] * _LABEL_STEP, 3, axis=-1)
        )
        outside = self._stage.add(outside_mesh(ground), ground.outside_rgb)
        self._kinds = {outside: SemanticClass.OUTSIDE, -1: SemanticClass.SKY}
        for solid in scene.solids:
            self._put(self._add(solid), solid, Pose(0.0, 0.0, 0.0))
        self._movers = [[(self._add(solid), solid) for solid in mover] for mover in movers]

    @property
    def shape(self) -> tuple[int, int, int]:
        """(H, W, 3) of one picture."""
        return self._image.shape

    def close(self) -> None:
        """Free PyBullet's client."""
        self._stage.close()

    def render(self, poses: np.ndarray, movers: np.ndarray | None = None) -> np.ndarray:
        """(N, H, W, 3) uint8 RGB, before any sensor effect; poses (N, 3): x, y [m], heading.

        ``movers`` as of `sim_pybullet.rendering.camera.BatchCamera`.
        """
        self._stage.place(self._labels, _AWAY_M)
        self._stage.place(self._floor, (0.0, 0.0, 0.0))
        return self._each(self._frame, poses, movers)

    def segment(self, poses: np.ndarray, movers: np.ndarray | None = None) -> np.ndarray:
        """(N, H, W) uint8, values of SemanticClass, from object ids and the floor's class map."""
        self._stage.place(self._floor, _AWAY_M)
        self._stage.place(self._labels, (0.0, 0.0, 0.0))
        return self._each(self._classes, poses, movers)

    def _each(
        self,
        draw: Callable[[np.ndarray], np.ndarray],
        poses: np.ndarray,
        movers: np.ndarray | None,
    ) -> np.ndarray:
        pictures = []
        for i, pose in enumerate(poses):
            for k, parts in enumerate(self._movers):
                for body, solid in parts:
                    at = Pose(*(np.full(3, np.nan) if movers is None else movers[i, k]))
                    self._put(body, solid, at)
            pictures.append(draw(pose))
        return np.array(pictures, np.uint8)

    def _add(self, solid: Solid) -> int:
        body = self._stage.add(solid_mesh(solid), solid.rgb)
        self._kinds[body] = solid.kind
        return body

    def _put(self, body: int, solid: Solid, origin: Pose) -> None:
        """Put a solid down that stands about an origin; away where that is nowhere."""
        if math.isnan(origin.x_m):
            self._stage.place(body, _AWAY_M)
        else:
            x_m, y_m = origin.to_world(np.array([solid.x_m, solid.y_m])).tolist()
            turned_rad = origin.heading_rad + solid.heading_rad
            self._stage.place(body, (x_m, y_m, solid.base_m), turned_rad)

    def _frame(self, pose: np.ndarray) -> np.ndarray:
        pictures = []
        light = light_row(self._scene.light)
        for view, sky in zip(self.cover.views, self._skies, strict=True):
            drawing = self._draw(view, pose, light)
            pictures.append(np.where((drawing.bodies < 0)[..., None], sky, drawing.rgb))
        return self.cover.warp(pictures)

    def _classes(self, pose: np.ndarray) -> np.ndarray:
        rays = pixel_rays(self._rig, self._image)
        labels = np.full(rays.seen.shape, SemanticClass.SKY, np.uint8)
        owner = np.argmax([rays.directions @ view.turn[:, 2] for view in self.cover.views], axis=0)
        for k, view in enumerate(self.cover.views):
            drawing = self._draw(view, pose, light_row(LightLook(ambient=1.0, diffuse=0.0)))
            column, row = np.moveaxis(np.round(view.locate(rays.directions)).astype(int), -1, 0)
            column = np.clip(column, 0, view.width_px - 1)
            row = np.clip(row, 0, view.height_px - 1)
            labels = np.where(owner == k, self._kinds_of(drawing)[row, column], labels)
        return np.where(rays.seen, labels, SemanticClass.SKY).astype(np.uint8)

    def _kinds_of(self, drawing: Drawing) -> np.ndarray:
        lookup = np.full(drawing.bodies.max(initial=0) + 2, SemanticClass.SKY, np.uint8)
        for body, kind in self._kinds.items():
            if body + 1 < len(lookup):
                lookup[body + 1] = kind
        painted = np.round(drawing.rgb[..., 0] / _LABEL_STEP).astype(np.uint8)
        return np.where(drawing.bodies == self._labels, painted, lookup[drawing.bodies + 1])

    def _draw(self, view: PinholeView, pose: np.ndarray, light: np.ndarray) -> Drawing:
        x, y, heading = pose
        c, s = math.cos(heading), math.sin(heading)
        turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        eye = turn @ self._rig.mount.position_m + (x, y, 0.0)
        return self._stage.draw(view, eye, turn @ view.turn, light)
