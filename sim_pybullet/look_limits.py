"""How far a Look may go: what is outside cannot be, or leaves a camera nothing to see."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

from robot.errors import ConfigError

Limits = tuple[float, float]

_SHARE: Limits = (0.0, 1.0)
_TIME_S: Limits = (0.0, 10.0)
_GAIN: Limits = (0.01, 10.0)
_LIMITS: dict[str, Limits] = {
    "camera.height_m": (0.01, 2.0),
    "camera.focal_scale": (0.2, 5.0),
    "camera.distortion_scale": (-2.0, 2.0),
    "camera.pitch_rad": (-math.pi / 2, math.pi / 2),
    "clutter.boxes": (0, 100),
    "clutter.people": (0, 100),
    "drive.delay_s": _TIME_S,
    "drive.forward_lag_s": _TIME_S,
    "drive.gain": _GAIN,
    "drive.noise": _SHARE,
    "drive.trim": (-1.0, 1.0),
    "drive.turn_gain": _GAIN,
    "drive.turn_lag_s": _TIME_S,
    "ground.brightness": (0.0, 10.0),
    "ground.grain": (0.0, 255.0),
    "ground.line_width_scale": (0.1, 5.0),
    "ground.patchiness": _SHARE,
    "ground.shadows": _SHARE,
    "ground.wear": _SHARE,
    "light.ambient": (0.0, 10.0),
    "light.diffuse": (0.0, 10.0),
    "light.gloss": _SHARE,
    "light.gloss_width_rad": (1e-3, math.pi),
    "pose.correlation_s": (1e-3, 1e6),
    "pose.delay_s": _TIME_S,
    "pose.dropout_per_s": (0.0, 100.0),
    "pose.dropout_s": (0.0, 1e6),
    "pose.heading_rad": (0.0, math.pi),
    "pose.outlier": _SHARE,
    "pose.position_m": (0.0, 100.0),
    "sensor.blur_px": (0.0, 50.0),
    "sensor.exposure": (0.0, 20.0),
    "sensor.infrared": _SHARE,
    "sensor.jpeg_quality": (1, 100),
    "sensor.noise": (0.0, 255.0),
    "sensor.shutter_s": (0.0, 1.0),
    "sensor.vignetting": _SHARE,
    "sensor.white_balance": (0.0, 20.0),
    "timing.camera_delay_s": _TIME_S,
    "timing.frame_skip": _SHARE,
    "track.centre_line": _SHARE,
    "track.dashes_m": (0.1, 1000.0),
    "track.wall_height_m": (0.0, 100.0),
}
_RGB: Limits = (0.0, 255.0)
_ANY: Limits = (-1e9, 1e9)


def refuse_impossible(look: Any) -> None:
    """Check every number of a Look.

    Raises:
        ConfigError: one is not finite, or outside its limits.
    """
    for group in dataclasses.fields(look):
        inner = getattr(look, group.name)
        for leaf in dataclasses.fields(inner):
            value, name = getattr(inner, leaf.name), f"{group.name}.{leaf.name}"
            low, high = _LIMITS.get(name, _RGB if leaf.name.endswith("_rgb") else _ANY)
            for number in value if isinstance(value, tuple) else (value,):
                if not isinstance(number, str) and not low <= number <= high:
                    raise ConfigError(f"look.{name}: expected {low:g} to {high:g}, got {number:g}")
