"""``PyBulletCamera``: the reference renderer, PyBullet's own picture warped to the lens.

PyBullet draws pinhole pictures. They must see at least as far as the lens does, or the warped one
has a lens's bend without its field of view.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from robot.contract import ImageSpec
from robot.geometry import Pose
from robot.lens import CameraRig
from sim_pybullet.bullet import Client, pybullet
from sim_pybullet.look import LightLook
from sim_pybullet.rendering.rays import pixel_rays, sky_rgb
from sim_pybullet.rendering.solid_geometry import light_row
from sim_pybullet.scene import Ground, Mover, Scene, SemanticClass, Solid

_NEAR_M, _FAR_M = 0.01, 300.0  # what a camera sees
_BELOW_M = 2e-3  # the floor's picture: what goes on beyond it
_LABEL_STEP = 20  # grey levels between two classes


class Stage:
    """A scene to be looked at, in a client without a window, drawn by PyBullet's TinyRenderer.

    ``movers`` are away until `move` says where they are.
    """

    def __init__(self, scene: Scene, movers: Sequence[Mover] = ()) -> None:
        self._client, ground = Client(), scene.ground
        self._add_floor(ground)
        middle_m = 0.5 * np.array(ground.classes.shape) * ground.texel_m
        x_m, y_m = ground.west_m + middle_m[1], ground.north_m - middle_m[0]
        far = (2.0 * _FAR_M, 2.0 * _FAR_M, 1.0)
        below = Solid("box", x_m, y_m, 0.0, far, ground.outside_rgb, base_m=-1.0 - _BELOW_M)
        for solid in (below, *scene.solids):
            self._place(self._add(solid), solid, Pose(0.0, 0.0, 0.0))
        self._movers = [[(self._add(solid), solid) for solid in mover] for mover in movers]
        self.move([Pose(np.nan, np.nan, np.nan)] * len(movers))

    def close(self) -> None:
        """Free the client; it cannot be used afterwards."""
        self._client.close()

    def move(self, poses: Sequence[Pose]) -> None:
        """Put every mover's origin somewhere; away where that is NaN."""
        for parts, pose in zip(self._movers, poses, strict=True):
            for body, solid in parts:
                self._place(body, solid, pose)

    def _add_floor(self, ground: Ground) -> None:
        height, width = ground.classes.shape
        west, north = ground.west_m, ground.north_m
        east, south = west + width * ground.texel_m, north - height * ground.texel_m
        shape = self._client.createVisualShape(
            pybullet.GEOM_MESH,
            vertices=[(west, south, 0), (east, south, 0), (east, north, 0), (west, north, 0)],
            normals=[(0, 0, 1)] * 4,
            uvs=[(0, 0), (1, 0), (1, 1), (0, 1)],
            indices=[0, 1, 2, 0, 2, 3],
            specularColor=(0.0, 0.0, 0.0),
        )
        body = self._client.createMultiBody(0.0, -1, shape)
        with tempfile.TemporaryDirectory() as folder:
            path = str(Path(folder) / "texture.png")
            cv2.imwrite(path, ground.rgb[..., ::-1], (cv2.IMWRITE_PNG_COMPRESSION, 1))
            number = self._client.loadTexture(path)
        self._client.changeVisualShape(body, -1, textureUniqueId=number)

    def _add(self, solid: Solid) -> int:
        length, width, height = solid.size_m
        shape = self._client.createVisualShape(
            pybullet.GEOM_CYLINDER if solid.shape == "cylinder" else pybullet.GEOM_BOX,
            radius=0.5 * length,
            length=height,
            halfExtents=(0.5 * length, 0.5 * width, 0.5 * height),
            rgbaColor=(*(value / 255.0 for value in solid.rgb), 1.0),
            specularColor=(0.0, 0.0, 0.0),
        )
        return int(self._client.createMultiBody(0.0, -1, shape))

    def _place(self, body: int, solid: Solid, origin: Pose) -> None:
        """Put a solid down that stands about an origin."""
        away = math.isnan(origin.x_m)
        x_m, y_m = (0.0, 0.0) if away else origin.to_world(np.array([solid.x_m, solid.y_m]))
        half = 0.0 if away else 0.5 * (origin.heading_rad + solid.heading_rad)
        z_m = -_FAR_M if away else solid.base_m + 0.5 * solid.size_m[2]
        turn = (0.0, 0.0, math.sin(half), math.cos(half))
        self._client.resetBasePositionAndOrientation(body, (x_m, y_m, z_m), turn)

    def draw(
        self, view: PinholeView, eye_m: np.ndarray, turn: np.ndarray, light: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """What a pinhole at ``eye_m`` sees: (H, W, 3) uint8 RGB; where that is nothing, (H, W).

        ``turn`` (3, 3) takes the view's axes to the world; ``light`` (5,) is the direction to the
        light, its ambient and its diffuse share. No shadows, no gloss.
        """
        world_to_gl = np.eye(4)
        world_to_gl[:3, :3] = (turn * (1.0, -1.0, -1.0)).T  # OpenGL looks along -z, y up
        world_to_gl[:3, 3] = -world_to_gl[:3, :3] @ eye_m
        # TinyRenderer takes a pixel's colour at its bottom left corner, we at its centre.
        shift = 0.5 * (view.high - view.low) / view.size_px * (1.0, -1.0)
        (left, bottom), (right, top) = _NEAR_M * (view.low + shift), _NEAR_M * (view.high + shift)
        frustum = self._client.computeProjectionMatrix(left, right, -top, -bottom, _NEAR_M, _FAR_M)
        width, height, rgba, _, bodies = self._client.getCameraImage(
            *view.size_px,
            viewMatrix=world_to_gl.T.ravel().tolist(),
            projectionMatrix=frustum,
            lightDirection=light[:3].tolist(),
            lightColor=(1.0, 1.0, 1.0),
            shadow=0,
            lightAmbientCoeff=float(light[3]),
            lightDiffuseCoeff=float(light[4]),
            lightSpecularCoeff=0.0,
            renderer=pybullet.ER_TINY_RENDERER,
        )
        rgb = np.asarray(rgba, np.uint8).reshape(height, width, 4)[..., :3]
        return np.ascontiguousarray(rgb), np.asarray(bodies).reshape(height, width) < 0


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

        ``movers`` as of `sim_pybullet.rendering.ray_camera.RayCamera`.
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
            rgb, nothing = self._draw(self._seen, view, pose, self._light)
            pictures.append(np.where(nothing[..., None], sky, rgb))
        return self.cover.warp(pictures)

    def _classes(self, pose: np.ndarray) -> np.ndarray:
        rays = pixel_rays(self._rig, self._image)
        labels = np.full(rays.seen.shape, SemanticClass.SKY, np.uint8)
        owner = np.argmax([rays.directions @ view.turn[:, 2] for view in self.cover.views], axis=0)
        even = light_row(LightLook(ambient=1.0, diffuse=0.0))
        for k, view in enumerate(self.cover.views):
            rgb, nothing = self._draw(self._kinds, view, pose, even)
            kinds = np.where(nothing, SemanticClass.SKY, np.round(rgb[..., 0] / _LABEL_STEP))
            pixels = np.round(view.locate(rays.directions)).astype(int)
            column, row = np.moveaxis(np.clip(pixels, 0, view.size_px - 1), -1, 0)
            labels = np.where(owner == k, kinds[row, column], labels)
        return np.where(rays.seen, labels, SemanticClass.SKY).astype(np.uint8)

    def _draw(
        self, stage: Stage, view: PinholeView, pose: np.ndarray, light: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
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


WIDEST_TAN = 2.0  # a lens that looks further off its axis is covered by several views
MARGIN_PX = 2


@dataclass(frozen=True)
class PinholeView:
    """One pinhole picture: ``turn`` (3, 3) takes the view's axes (x right, y down, z forward) to
    the robot frame; ``low`` and ``high`` (2,) are tangents, x / z and y / z, of its edges, and
    ``size_px`` (2,) its width and height."""

    turn: np.ndarray
    low: np.ndarray
    high: np.ndarray
    size_px: np.ndarray

    def directions(self) -> np.ndarray:
        """(height, width, 3) unit rays in the robot frame, one per pixel."""
        sides = zip(self.low, self.high, self.size_px, strict=True)
        x, y = (low + (np.arange(n) + 0.5) / n * (high - low) for low, high, n in sides)
        plane = np.stack((*np.meshgrid(x, y), np.ones((len(y), len(x)))), axis=-1) @ self.turn.T
        return np.asarray(plane / np.linalg.norm(plane, axis=-1, keepdims=True))

    def locate(self, directions: np.ndarray) -> np.ndarray:
        """Robot-frame rays (..., 3) -> pixels (..., 2) of this view, for rays in front of it."""
        local = directions @ self.turn
        share = (local[..., :2] / np.maximum(local[..., 2:], 1e-9) - self.low) / (
            self.high - self.low
        )
        return np.asarray(share * self.size_px - 0.5)


@dataclass(frozen=True)
class Cover:
    """The views and, for the lens's picture enlarged ``oversample`` times, where to read them.

    ``maps``: per view (2, sH, sW) float32 source columns and rows; ``owner`` (sH, sW): which view
    to read; ``seen`` (sH, sW): where the lens has a pixel at all.
    """

    views: tuple[PinholeView, ...]
    maps: tuple[np.ndarray, ...]
    owner: np.ndarray
    seen: np.ndarray
    oversample: int

    def warp(self, pictures: list[np.ndarray]) -> np.ndarray:
        """The lens's picture (H, W, 3) uint8 from the views' pictures, averaged over each pixel."""
        large = np.zeros((*self.owner.shape, 3), np.uint8)
        for k, (picture, where) in enumerate(zip(pictures, self.maps, strict=True)):
            read = cv2.remap(
                picture, where[0], where[1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
            )
            large = np.where((self.owner == k)[..., None], read, large)
        large[~self.seen] = 0
        height, width = self.owner.shape
        size = (width // self.oversample, height // self.oversample)
        return np.asarray(cv2.resize(large, size, interpolation=cv2.INTER_AREA))


def cover(rig: CameraRig, image: ImageSpec, oversample: int) -> Cover:
    """Views that cover a rig's picture at ``oversample`` times its resolution."""
    large = ImageSpec(
        image.width_px * oversample, image.height_px * oversample, image.crop_top_px * oversample
    )
    rays = pixel_rays(rig, large)
    turns = _turns(rig, rays.directions[rays.seen])
    local = np.stack([rays.directions @ turn for turn in turns])  # (K, sH, sW, 3)
    owner = np.argmax(local[..., 2] / np.abs(local).max(axis=-1), axis=0)
    used = [k for k in range(len(turns)) if (rays.seen & (owner == k)).any()]
    focal_px = rig.lens.scaled(large.width_px, large.height_px).fx_px  # as sharp as in its middle
    views = tuple(_view(turns[k], local[k][rays.seen & (owner == k)], focal_px) for k in used)
    maps = tuple(
        np.ascontiguousarray(np.moveaxis(view.locate(rays.directions), -1, 0), np.float32)
        for view in views
    )
    return Cover(views, maps, np.searchsorted(used, owner), rays.seen, oversample)


def _turns(rig: CameraRig, directions: np.ndarray) -> list[np.ndarray]:
    """One view along the optical axis, or as many sides of a cube about it as are needed."""
    front = rig.mount.rotation
    local = directions @ front
    if (np.abs(local[:, :2]) < WIDEST_TAN * local[:, 2:]).all():
        return [front]
    quarters = np.array([(0, 0, 0), (0, 1, 0), (0, -1, 0), (1, 0, 0), (-1, 0, 0), (0, 2, 0)])
    return [front @ cv2.Rodrigues(0.5 * math.pi * turn)[0] for turn in quarters]


def _view(turn: np.ndarray, local: np.ndarray, focal_px: float) -> PinholeView:
    """The smallest view that holds these rays (M, 3) in its axes."""
    plane = local[:, :2] / local[:, 2:]
    margin = MARGIN_PX / focal_px
    low, high = plane.min(axis=0) - margin, plane.max(axis=0) + margin
    return PinholeView(turn, low, high, np.ceil((high - low) * focal_px).astype(int))
