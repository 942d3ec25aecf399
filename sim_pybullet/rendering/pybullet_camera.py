"""``PyBulletCamera``: the reference renderer, PyBullet's own picture warped to the lens."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from robot.contract import ImageSpec
from robot.geometry import Pose
from robot.lens import CameraRig
from sim_pybullet.bullet import Drawing, Stage
from sim_pybullet.classes import SemanticClass
from sim_pybullet.look import LightLook
from sim_pybullet.rendering.pinhole_cover import PinholeView, cover
from sim_pybullet.rendering.rays import pixel_rays, sky_rgb
from sim_pybullet.rendering.solid_table import light_row
from sim_pybullet.scene import Mover, Scene, Solid

_LABEL_STEP = 20  # grey levels between two classes


class PyBulletCamera:
    """Draws one scene through one rig, robot after robot.

    PyBullet draws pinhole views that cover the whole lens, ``oversample`` times as fine as the
    picture; each pixel then averages the views where its exact rays meet them. Classes are drawn
    as colours under an even light.
    """

    def __init__(
        self,
        scene: Scene,
        rig: CameraRig,
        image: ImageSpec,
        oversample: int = 2,
        movers: tuple[Mover, ...] = (),
    ) -> None:
        self._light, self._rig, self._image = light_row(scene.light), rig, image
        self.cover = cover(rig, image, oversample)
        self._skies = [sky_rgb(view.directions(), scene.sky) for view in self.cover.views]
        self._seen = Stage(scene, movers)
        labels = np.repeat(scene.ground.classes[..., None] * _LABEL_STEP, 3, axis=-1)
        floor = replace(scene.ground, rgb=labels, outside_rgb=_label(SemanticClass.OUTSIDE))
        solids = tuple(map(_labelled, scene.solids))
        kinds = [tuple(map(_labelled, mover)) for mover in movers]
        self._kinds = Stage(replace(scene, ground=floor, solids=solids), kinds)

    @property
    def shape(self) -> tuple[int, int, int]:
        """(H, W, 3) of one picture."""
        return self._image.shape

    def close(self) -> None:
        """Free PyBullet's clients."""
        self._seen.close()
        self._kinds.close()

    def render(self, poses: np.ndarray, movers: np.ndarray | None = None) -> np.ndarray:
        """(N, H, W, 3) uint8 RGB, before any sensor effect; poses (N, 3): x, y [m], heading.

        ``movers`` as of `sim_pybullet.rendering.camera.BatchCamera`.
        """
        return self._each(self._seen, self._frame, poses, movers)

    def segment(self, poses: np.ndarray, movers: np.ndarray | None = None) -> np.ndarray:
        """(N, H, W) uint8, values of SemanticClass."""
        return self._each(self._kinds, self._classes, poses, movers)

    def _each(
        self,
        stage: Stage,
        draw: Callable[[np.ndarray], np.ndarray],
        poses: np.ndarray,
        movers: np.ndarray | None,
    ) -> np.ndarray:
        pictures = []
        for i, pose in enumerate(poses):
            if movers is not None:
                stage.move([Pose(*each) for each in movers[i]])
            pictures.append(draw(pose))
        return np.array(pictures, np.uint8)

    def _frame(self, pose: np.ndarray) -> np.ndarray:
        pictures = []
        for view, sky in zip(self.cover.views, self._skies, strict=True):
            drawing = self._draw(self._seen, view, pose, self._light)
            pictures.append(np.where((drawing.bodies < 0)[..., None], sky, drawing.rgb))
        return self.cover.warp(pictures)

    def _classes(self, pose: np.ndarray) -> np.ndarray:
        rays = pixel_rays(self._rig, self._image)
        labels = np.full(rays.seen.shape, SemanticClass.SKY, np.uint8)
        owner = np.argmax([rays.directions @ view.turn[:, 2] for view in self.cover.views], axis=0)
        even = light_row(LightLook(ambient=1.0, diffuse=0.0))
        for k, view in enumerate(self.cover.views):
            drawing = self._draw(self._kinds, view, pose, even)
            kinds = np.round(drawing.rgb[..., 0] / _LABEL_STEP)
            kinds[drawing.bodies < 0] = SemanticClass.SKY
            pixels = np.round(view.locate(rays.directions)).astype(int)
            column, row = np.moveaxis(np.clip(pixels, 0, view.size_px - 1), -1, 0)
            labels = np.where(owner == k, kinds[row, column], labels)
        return np.where(rays.seen, labels, SemanticClass.SKY).astype(np.uint8)

    def _draw(
        self, stage: Stage, view: PinholeView, pose: np.ndarray, light: np.ndarray
    ) -> Drawing:
        x, y, heading = pose
        c, s = math.cos(heading), math.sin(heading)
        turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        eye = turn @ self._rig.mount.position_m + (x, y, 0.0)
        return stage.draw(view, eye, turn @ view.turn, light)


def _label(kind: SemanticClass) -> tuple[float, float, float]:
    level = float(_LABEL_STEP * kind)
    return level, level, level


def _labelled(solid: Solid) -> Solid:
    return replace(solid, rgb=_label(solid.kind))
