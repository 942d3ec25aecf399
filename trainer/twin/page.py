"""What a fit found, as one HTML page: values, what was not seen, and pictures side by side."""

from __future__ import annotations

import base64
from pathlib import Path

import numpy as np

from robot.recording.drive_file import png
from sim_pybullet.painting.ground import paint_ground
from sim_pybullet.scene import Scene
from sim_pybullet.sensing.sensor import apply_sensor
from trainer.report.page import write_page
from trainer.twin.colours import seen_from
from trainer.twin.fit import Twin
from trainer.twin.recorded import Recorded

SHOWN = 6


def twin_pictures(twin: Twin, drive: Recorded) -> np.ndarray:
    """(F, 120, 160, 3) what the twin's camera sees where the key pictures were taken."""
    look = twin.look
    scene = Scene(paint_ground(drive.road_map, look.ground), (), look.sky, look.light)
    drawn = seen_from(scene, twin.camera.values, twin.camera.poses)
    return apply_sensor(drawn, [look.sensor] * len(drawn), np.random.default_rng(0))


def write_twin_page(twin: Twin, drive: Recorded, path: Path) -> None:
    """Recorded pictures beside the twin's, under the table of what was found."""
    both = twin.pictures, twin_pictures(twin, drive)
    chosen = np.linspace(0, len(twin.pictures) - 1, SHOWN).astype(int)
    pairs = [[base64.b64encode(png(some[k])).decode("ascii") for some in both] for k in chosen]
    write_page("twin.html", path, twin=twin, seconds=drive.seconds, pairs=pairs)
