"""What keeps painted lines where they are while CycleGAN learns."""

from __future__ import annotations

import torch
from torch.nn import functional

WINDOW_PX = 7
_NO_PAINT = 1e-3  # variance of the template below which a window shows no edge of a line
_FLAT = 0.2  # standard deviation that bare road may have, of a range of 2
_FLOOR = 1e-4  # variance that counts as none


def structure(translation: torch.Tensor, paint: torch.Tensor) -> torch.Tensor:
    """How little the painted lines of a translation lie where the simulator painted them.

    Around every edge of a line the brightness must go as the paint does, and the yellowness as the
    yellow paint does, whatever the light and the colour of the road: one minus their normalised
    cross-correlation in windows. Bare road must show no contrast like that of a line.

    Args:
        translation: (N, 3, H, W) in [-1, 1].
        paint: (N, 4, H, W) in [0, 1], shares of white, yellow and red paint and of road.

    Returns:
        A scalar, 0 at best.
    """
    red, green, blue = translation.unbind(1)
    brightness = (red + green + blue)[:, None] / 3.0
    yellowness = (0.5 * (red + green) - blue)[:, None]
    white, yellow, _, road = (part[:, None] for part in paint.unbind(1))
    unlike = _unlike(brightness, white + 0.8 * yellow) + _unlike(yellowness, yellow)
    return unlike + _contrast(brightness, road)


def _unlike(seen: torch.Tensor, template: torch.Tensor) -> torch.Tensor:
    mean_seen, mean_template = _pooled(seen), _pooled(template)
    covariance = _pooled(seen * template) - mean_seen * mean_template
    seen_variance = (_pooled(seen * seen) - mean_seen**2).clamp_min(0.0)
    variance = (_pooled(template * template) - mean_template**2).clamp_min(0.0)
    likeness = covariance / torch.sqrt((seen_variance + _FLOOR) * (variance + _FLOOR))
    weight = torch.sqrt(variance) * (variance > _NO_PAINT)
    return (weight * (1.0 - likeness)).sum() / weight.sum().clamp_min(1.0)


def _contrast(brightness: torch.Tensor, road: torch.Tensor) -> torch.Tensor:
    bare = (_pooled(road) > 0.99).float()
    variance = (_pooled(brightness**2) - _pooled(brightness) ** 2).clamp_min(0.0)
    excess = functional.relu(torch.sqrt(variance + _FLOOR) - _FLAT)
    return (bare * excess).sum() / bare.sum().clamp_min(1.0)


def _pooled(values: torch.Tensor) -> torch.Tensor:
    return functional.avg_pool2d(values, WINDOW_PX, 1)
