"""The ray camera's tables and floors on a torch device."""

from __future__ import annotations

import numpy as np
import torch

from sim_pybullet.rendering.mip_texture import MipTexture
from sim_pybullet.rendering.rays import FloorTable

FLOOR, LEVEL, LOG_TAPS = range(3)  # planes of the codes
SPREAD = 0.125  # of the four rays through a pixel, see solid_kernel


class DeviceTables:
    """Per slot, P pixels: ``points`` (S, 4, P) are x, y, dx, dy of a ``FloorTable``, ``codes``
    (S, 3, P) whether it is floor, its level and log2(taps), ``rays`` (S, 5, 3, P) the four rays
    through a pixel's quarters and the one through its middle."""

    def __init__(self, pixels: int, device: torch.device) -> None:
        self._stored: list[FloorTable | None] = []
        self._device = device
        self.points = torch.zeros((0, 4, pixels), device=device)
        self.codes = torch.zeros((0, 3, pixels), dtype=torch.int32, device=device)
        self.rays = torch.zeros((0, 5, 3, pixels), device=device)

    def put(self, slot: int, table: FloorTable, directions: np.ndarray) -> None:
        """Let a slot hold this table and these directions (H, W, 3), unless it does."""
        if slot < len(self._stored) and self._stored[slot] is table:
            return
        if slot >= len(self._stored):
            count = max(slot + 1, 2 * len(self._stored))
            self._stored += [None] * (count - len(self._stored))
            self.points = _longer(self.points, count)
            self.codes = _longer(self.codes, count)
            self.rays = _longer(self.rays, count)
        self._stored[slot] = table
        points = np.stack((table.x, table.y, table.dx, table.dy))
        self.points[slot] = torch.from_numpy(points).to(self._device)
        self.codes[slot] = torch.from_numpy(_codes(table)).to(self._device)
        self.rays[slot] = torch.from_numpy(_rays(directions)).to(self._device)


class DeviceFloors:
    """Packed floors one after the other, (T,) int32 ``texels``; each is copied once."""

    def __init__(self, device: torch.device) -> None:
        self._device = device
        self._held: dict[int, tuple[MipTexture, int]] = {}  # by identity: floor, offset
        self.texels = torch.zeros(0, dtype=torch.int32, device=device)

    def offsets(self, wanted: list[MipTexture]) -> np.ndarray:
        """Where each wanted floor begins, (N,) int64. Floors that nobody wants may go."""
        new = {id(floor): floor for floor in wanted if id(floor) not in self._held}
        if new:
            needed = sum(len(floor.texels) for floor in {id(f): f for f in wanted}.values())
            if len(self.texels) > 4 * needed:
                new = {id(floor): floor for floor in wanted}
                self._held, self.texels = {}, self.texels[:0]
            pieces, end = [self.texels], len(self.texels)
            for floor in new.values():
                self._held[id(floor)] = (floor, end)
                pieces.append(torch.from_numpy(floor.texels.view(np.int32)).to(self._device))
                end += len(floor.texels)
            self.texels = torch.cat(pieces)
        return np.array([self._held[id(floor)][1] for floor in wanted], np.int64)


def _longer(tensor: torch.Tensor, count: int) -> torch.Tensor:
    return torch.cat((tensor, tensor.new_zeros((count - len(tensor), *tensor.shape[1:]))))


def _codes(table: FloorTable) -> np.ndarray:
    codes = np.zeros((3, len(table.x)), np.int32)
    for first, last, level, log_taps in table.runs:
        codes[:, first:last] = np.array((1, level, log_taps))[:, None]
    return codes


def _rays(directions: np.ndarray) -> np.ndarray:
    """(5, 3, P) float32: the same rays that the compiled camera casts."""
    padded = np.pad(directions, ((1, 1), (1, 1), (0, 0)), mode="edge")
    right = padded[1:-1, 2:] - padded[1:-1, :-2]
    down = padded[2:, 1:-1] - padded[:-2, 1:-1]
    offsets = [(-SPREAD, -SPREAD), (SPREAD, -SPREAD), (-SPREAD, SPREAD), (SPREAD, SPREAD), (0, 0)]
    rays = np.stack([directions + a * right + b * down for a, b in offsets])
    return np.moveaxis(rays, -1, 1).reshape(5, 3, -1).astype(np.float32)
