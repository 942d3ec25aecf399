"""The floor by PyTorch: the arithmetic of ``floor_kernel`` over whole pictures at once."""

from __future__ import annotations

from typing import NamedTuple

import torch

from sim_pybullet.rendering.torch_tables import FLOOR, LEVEL, LOG_TAPS

RED, GREEN, BLUE, KIND = 0, 12, 24, 8  # where a texel holds them, see mip_texture


class DeviceViews(NamedTuple):
    """What N robots look at, as ``FloorViews``, with each floor's offset among all ``texels``."""

    placed: torch.Tensor  # (N, 4) float64
    offsets: torch.Tensor  # (N,) int64
    levels: torch.Tensor  # (N, L, 3) int64
    points: torch.Tensor  # (N, 4, P) float32
    codes: torch.Tensor  # (N, 3, P) int32
    texels: torch.Tensor  # (T,) int32


def draw_floor(views: DeviceViews, skies: torch.Tensor) -> torch.Tensor:
    """Pictures (N, P, 3) int32 of the floor, and of ``skies`` (N, P, 3) where there is none."""
    level = views.codes[:, LEVEL].long()
    log_taps = views.codes[:, LOG_TAPS]
    offset, stride, height = (_per_pixel(views.levels[..., k], level) for k in range(3))
    offset = offset + views.offsets[:, None]
    scale = 256.0 / 2.0 ** torch.arange(views.levels.shape[1], device=level.device)
    column0, row0 = (
        _per_pixel((views.placed[:, k, None] * scale + 128.0).float(), level) for k in range(2)
    )
    c, s = (256.0 * views.placed[:, k, None].to(torch.float32) for k in (2, 3))
    right, bottom = ((extent - 1) * 256 - 1 for extent in (stride, height))
    x, y, dx, dy = views.points.unbind(1)
    total = (128 << log_taps)[..., None].repeat(1, 1, 3)
    for tap in range(1 << int(log_taps.max())):
        ahead, left = x + tap * dx, y + tap * dy
        u = torch.clamp(c * ahead - s * left + column0, min=0.0).minimum(right).int()
        v = torch.clamp(row0 - s * ahead - c * left, min=0.0).minimum(bottom).int()
        texel = offset + (v >> 8) * stride + (u >> 8)
        colour = _bilinear(views.texels, texel, stride, u & 255, v & 255)
        total += torch.where((tap < (1 << log_taps))[..., None], colour, 0)
    floor = total >> (8 + log_taps)[..., None]
    return torch.where(views.codes[:, FLOOR, :, None] > 0, floor, skies.int())


def label_floor(views: DeviceViews, skies: torch.Tensor) -> torch.Tensor:
    """Classes (N, P) int32 where the rays meet the floor, ``skies`` (N, P) where they do not."""
    x, y, dx, dy = views.points.double().unbind(1)
    middle = 0.5 * ((1 << views.codes[:, LOG_TAPS]) - 1)
    scale = (1 << views.codes[:, LEVEL]).double()
    x, y = (x + middle * dx) * scale, (y + middle * dy) * scale
    column0, row0, c, s = (views.placed[:, k, None] for k in range(4))
    wide, high = views.levels[:, 0, 1, None], views.levels[:, 0, 2, None]
    u = torch.clamp(c * x - s * y + column0 + 1.0, min=0.0).minimum(wide - 1.0).long()
    v = torch.clamp(row0 - s * x - c * y + 1.0, min=0.0).minimum(high - 1.0).long()
    texel = views.texels[views.offsets[:, None] + v * wide + u]
    return torch.where(views.codes[:, FLOOR] > 0, texel >> KIND & 15, skies.int())


def _per_pixel(values: torch.Tensor, level: torch.Tensor) -> torch.Tensor:
    """Values per level (N, L) at each pixel's level (N, P)."""
    return torch.gather(values, 1, level)


def _bilinear(
    texels: torch.Tensor,
    first: torch.Tensor,
    stride: torch.Tensor,
    fx: torch.Tensor,
    fy: torch.Tensor,
) -> torch.Tensor:
    """(N, P, 3) int32: four texels weighted to a sum of 256."""
    both = (fx * fy + 128) >> 8
    total: torch.Tensor | int = 0
    corners = ((0, 256 - fx - fy + both), (1, fx - both), (stride, fy - both), (stride + 1, both))
    for step, weight in corners:
        texel = texels[first + step]
        colour = torch.stack([texel >> shift & 255 for shift in (RED, BLUE, GREEN)], dim=-1)
        total = total + colour[..., [0, 2, 1]] * weight[..., None]
    assert isinstance(total, torch.Tensor)
    return total
