"""``TorchRayCamera``: the ray camera's pictures by PyTorch, for a GPU where there is one."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import torch

from robot.contract import ImageSpec
from robot.lens import CameraRig
from sim_pybullet.rendering import floor_torch
from sim_pybullet.rendering.mip_texture import MipTexture, mip_texture
from sim_pybullet.rendering.ray_camera import RayCamera
from sim_pybullet.rendering.rays import floor_shade, floor_table, pixel_rays
from sim_pybullet.rendering.solid_kernel import gather_in_sight
from sim_pybullet.rendering.solid_torch import NOTHING, Candidates, Seen, blend_solids, meet_solids
from sim_pybullet.rendering.torch_tables import DeviceFloors, DeviceTables
from sim_pybullet.scene import Scene

MOST_PIXELS = 1 << 22  # drawn at once: bounds the memory of a call


class TorchRayCamera(RayCamera):
    """As ``RayCamera``, drawn on a torch device; the pictures differ by rounding only.

    ``render_tensor`` leaves them there, for a network on the same device.
    """

    def __init__(self, image: ImageSpec, n_robots: int, device: str = "cuda") -> None:
        super().__init__(image, n_robots)
        self.device = torch.device(device)
        self._device_tables = DeviceTables(image.shape[0] * image.shape[1], self.device)
        self._device_floors = DeviceFloors(self.device)
        self._device_skies = torch.zeros(self._skies.shape, dtype=torch.uint8, device=self.device)
        self._textures: list[MipTexture | None] = [None] * n_robots

    def set_robot(self, i: int, scene: Scene, rig: CameraRig) -> None:
        """Give robot ``i`` its world and its camera."""
        super().set_robot(i, scene, rig)
        self._textures[i] = mip_texture(scene.ground, floor_shade(scene.light))
        table = floor_table(rig, self._image, scene.ground.texel_m)
        directions = pixel_rays(rig, self._image).directions
        self._device_tables.put(int(self._tables.slots[i]), table, directions)
        self._device_skies[i] = torch.from_numpy(self._skies[i]).to(self.device)

    def render(self, poses: np.ndarray, robots: np.ndarray | None = None) -> np.ndarray:
        """(N, H, W, 3) uint8 RGB, before any sensor effect; see ``RayCamera.render``."""
        return self.render_tensor(poses, robots).cpu().numpy()

    @torch.no_grad()
    def render_tensor(self, poses: np.ndarray, robots: np.ndarray | None = None) -> torch.Tensor:
        """As ``render``: (N, H, W, 3) uint8 on the device."""
        robots = np.arange(len(self._scenes)) if robots is None else np.asarray(robots)
        poses = self._checked(poses, len(robots))
        pictures = [torch.zeros((0, *self.shape), dtype=torch.uint8, device=self.device)]
        for part in self._parts(len(poses)):
            views = self._device_views(poses[part], robots[part])
            skies = self._device_skies[self._upload(robots[part])]
            drawn = floor_torch.draw_floor(views, skies.reshape(len(skies), -1, 3))
            seen = self._meet(poses[part], robots[part], labels=False)
            drawn = drawn if seen is None else blend_solids(drawn, seen)
            pictures.append(drawn.to(torch.uint8).reshape(-1, *self.shape))
        return torch.cat(pictures)

    @torch.no_grad()
    def segment(self, poses: np.ndarray) -> np.ndarray:
        """(N, H, W) uint8, values of SemanticClass."""
        robots = np.arange(len(self._scenes))
        poses = self._checked(poses, len(robots))
        labels = []
        for part in self._parts(len(poses)):
            views = self._device_views(poses[part], robots[part])
            kinds = floor_torch.label_floor(views, self._upload(self._sky_kinds[part]))
            seen = self._meet(poses[part], robots[part], labels=True)
            if seen is not None:
                met = (seen.depth < NOTHING).reshape(kinds.shape)
                kinds = torch.where(met, seen.colour.reshape(kinds.shape), kinds)
            labels.append(kinds.to(torch.uint8).cpu().numpy().reshape(-1, *self.shape[:2]))
        return np.concatenate(labels)

    def _parts(self, count: int) -> Iterator[slice]:
        step = max(1, MOST_PIXELS // (self.shape[0] * self.shape[1]))
        return (slice(first, first + step) for first in range(0, count, step))

    def _upload(self, array: np.ndarray) -> torch.Tensor:
        return torch.from_numpy(np.ascontiguousarray(array)).to(self.device)

    def _device_views(self, poses: np.ndarray, robots: np.ndarray) -> floor_torch.DeviceViews:
        views = self._floor_views(poses, robots)
        textures = [texture for texture in self._textures if texture is not None]
        offsets = self._device_floors.offsets(textures)
        slots = self._upload(views.slots)
        return floor_torch.DeviceViews(
            self._upload(views.placed),
            self._upload(offsets[robots]),
            self._upload(views.levels.astype(np.int64)),
            self._device_tables.points[slots],
            self._device_tables.codes[slots],
            self._device_floors.texels,
        )

    def _meet(self, poses: np.ndarray, robots: np.ndarray, labels: bool) -> Seen | None:
        """What the rays meet of solids; None when no robot has any in sight."""
        found = gather_in_sight(self._solid_views(poses, robots), labels)
        if len(found.rows) == 0:
            return None
        rays = self._device_tables.rays
        return meet_solids(
            Candidates(
                self._upload(found.rows.astype(np.float32)),
                self._upload(found.colours.astype(np.int32)),
                self._upload(found.robots),
                self._upload(found.boxes),
                self._upload(found.lights.astype(np.float32)),
            ),
            rays[:, 4:] if labels else rays[:, :4],
            self._upload(self._tables.slots[robots]),
            self.shape[1],
            side_lit=not labels,
        )
