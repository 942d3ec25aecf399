"""A colour's range from a spot of the picture where it is: no arena is lit like another."""

from __future__ import annotations

import numpy as np

from localizer_node.calibration import Colour
from localizer_node.colour import to_hsv
from robot.errors import ConfigError

HUE_REACH_DEG = 20.0  # either way; noise and lamps of another temperature shift a hue by half of it
SATURATION_PART = 0.55  # of the spot's: a mirroring lamp washes a colour out
VALUE_PART = 0.5  # of the spot's: what is left in a shadow
LEAST_SATURATION = 0.25
SPOT_PX = 3


def learn_colour(name: str, image: np.ndarray, u_px: float, v_px: float) -> Colour:
    """The colour around one pixel of an RGB picture (H, W, 3).

    Raises:
        ConfigError: outside the picture, or grey there.
    """
    height, width = image.shape[:2]
    u, v = round(u_px), round(v_px)
    if not (SPOT_PX <= u < width - SPOT_PX and SPOT_PX <= v < height - SPOT_PX):
        raise ConfigError(
            f"colour {name!r}: ({u}, {v}) px is not inside the {width}x{height} picture"
        )
    spot = image[v - SPOT_PX : v + SPOT_PX + 1, u - SPOT_PX : u + SPOT_PX + 1]
    hue, saturation, value = np.moveaxis(to_hsv(spot).reshape(-1, 3).astype(float), 1, 0)
    vivid = float(np.median(saturation)) / 255.0
    if vivid < LEAST_SATURATION:
        raise ConfigError(
            f"colour {name!r}: expected a colour at ({u}, {v}) px, got grey (saturation "
            f"{vivid:.2f}); point at the middle of the patch, or paint it more vividly"
        )
    turn = np.exp(2j * np.deg2rad(hue))  # OpenCV's hue is half degrees, and runs round
    middle = float(np.rad2deg(np.angle(turn.mean()))) % 360.0
    low, high = ((middle + reach) % 360.0 for reach in (-HUE_REACH_DEG, HUE_REACH_DEG))
    least_value = VALUE_PART * float(np.median(value)) / 255.0
    return Colour(name, low, high, SATURATION_PART * vivid, least_value)
