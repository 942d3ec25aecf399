"""The colour of the sky by direction: one gradient for both cameras."""

from __future__ import annotations

import numpy as np

from sim_pybullet.look import SkyLook


def sky_rgb(directions: np.ndarray, sky: SkyLook) -> np.ndarray:
    """(..., 3) uint8 of unit directions (..., 3): from the horizon's colour to the zenith's."""
    share = np.sqrt(np.clip(directions[..., 2:], 0.0, 1.0))
    rgb = (1.0 - share) * np.array(sky.horizon_rgb) + share * np.array(sky.zenith_rgb)
    return np.round(rgb).astype(np.uint8)
