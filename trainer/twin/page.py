"""What a fit found, as one HTML page: values, what was not seen, and pictures side by side."""

from __future__ import annotations

import base64
import html
from pathlib import Path
from typing import Any

import numpy as np

from robot.output import write_text
from robot.recording.drive_file import png
from sim_pybullet.painting.ground import paint_ground
from sim_pybullet.scene import Scene
from sim_pybullet.sensing.sensor import apply_sensor
from trainer.twin.colours import seen_from
from trainer.twin.fit import Twin
from trainer.twin.recorded import Recorded

SHOWN = 6
_STYLE = (
    "body{font:16px sans-serif;margin:2em;max-width:60em}td,th{padding:.1em .8em;text-align:left}"
)


def twin_pictures(twin: Twin, drive: Recorded) -> np.ndarray:
    """(F, 120, 160, 3) what the twin's camera sees where the key pictures were taken."""
    look = twin.look
    scene = Scene(paint_ground(drive.road_map, look.ground), (), look.sky, look.light)
    drawn = seen_from(scene, twin.camera.values, twin.camera.poses)
    return apply_sensor(drawn, [look.sensor] * len(drawn), np.random.default_rng(0))


def write_page(twin: Twin, drive: Recorded, path: Path) -> None:
    """Recorded pictures beside the twin's, under the table of what was found."""
    ours = twin_pictures(twin, drive)
    chosen = np.linspace(0, len(ours) - 1, SHOWN).astype(int)
    pairs = "".join(_row(twin.pictures[k], ours[k]) for k in chosen)
    rows = "".join(
        f"<tr><td>{name}<td>{_told(value)}<td>± {2.0 * sd:.3g}"
        for name, (value, sd) in twin.found.items()
    )
    unseen = "".join(f"<li>{html.escape(line)}" for line in twin.unseen)
    write_text(
        path,
        f"<!doctype html><meta charset=utf-8><title>Twin</title><style>{_STYLE}</style>"
        f"<h1>A twin after {drive.seconds:.0f} s of driving</h1>"
        f"<p>The map explains {twin.camera.share:.0%} of what its pictures show of the road.</p>"
        f"<h2>Recorded, and as the twin sees it</h2><table>{pairs}</table>"
        f"<h2>Found (95 %)</h2><table><tr><th>of the look<th>value<th>{rows}</table>"
        f"<h2>Not shown by the drive</h2><ul>{unseen}</ul>",
    )


def _told(value: Any) -> str:
    if isinstance(value, list):
        return ", ".join(f"{each:.0f}" for each in value)
    return f"{value:.4g}"


def _row(*pictures: np.ndarray) -> str:
    cells = (base64.b64encode(png(picture)).decode("ascii") for picture in pictures)
    return "<tr>" + "".join(f'<td><img width=400 src="data:image/png;base64,{c}">' for c in cells)
