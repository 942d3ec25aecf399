"""Small recordings of drives to convert."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from robot.contract import Stick
from robot.recording.drive_file import png
from robot.recording.reader import Sample
from tools.data.drives import write_drive

WALL_S = 1.7e9


def samples(count: int = 30, seed: int = 0) -> list[Sample]:
    """Three seconds: the policy drives, a person takes over for the middle third."""
    rng = np.random.default_rng(seed)
    found = []
    for i in range(count):
        shade = np.linspace(20, 200, 160)[None, :, None] * np.linspace(0.4, 1.0, 3)
        image = np.clip(np.broadcast_to(shade, (120, 160, 3)) + 2.0 * i, 0, 255).astype(np.uint8)
        wheels = Stick(*rng.uniform(-0.8, 0.8, 2)).wheels
        driver = "person" if count // 3 <= i < 2 * count // 3 else "policy"
        found.append(Sample(WALL_S + 0.1 * i, png(image), wheels, driver))
    return found


def recorded(folder: Path, name: str, count: int = 30) -> Path:
    """Such a drive as a recording; by its name another one."""
    return write_drive(folder, name, "daisy", samples(count, seed=sum(name.encode())))
