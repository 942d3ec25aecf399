"""Sheets of pictures: race tracks from above, and a frame of each look of the shipped ones.

``python -m sim_pybullet.show_tracks --out docs/img``
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from robot.command_line import OneLineParser, answer
from robot.contract import ImageSpec
from robot.output import expect_writable
from sim_pybullet.look import NOMINAL, Look
from sim_pybullet.racing.track import Track, centre_line, load_track, shipped_tracks
from sim_pybullet.racing.track_ground import paint_track
from sim_pybullet.randomise import load_look_sampler, looks_of
from sim_pybullet.rendering.ray_camera import RayCamera
from sim_pybullet.scenery.place import place_scene
from sim_pybullet.show_cameras import coloured, write_picture

FRAME = ImageSpec(160, 120)
PANEL_PX = 300
_SHOWN_AT = 0.3  # of a lap: where the frames are taken


def from_above(tracks: Sequence[Track]) -> np.ndarray:
    """One panel per track, three in a row, north up; (H, W, 3) uint8 RGB."""
    panels = [_panel(track) for track in tracks]
    panels += [np.full_like(panels[0], 255)] * (-len(panels) % 3)
    rows = [np.hstack(panels[k : k + 3]) for k in range(0, len(panels), 3)]
    return np.vstack(rows)


def frames_of_looks(track: Track, names: Sequence[str], looks: Sequence[Look]) -> np.ndarray:
    """One frame per look, four in a row, the last the classes; (H, W, 3) uint8 RGB."""
    line = centre_line(track)
    pose = np.array([line.path.pose_at(_SHOWN_AT * line.path.length_m)])
    tiles = []
    for name, look in zip(names, looks, strict=True):
        camera = RayCamera(FRAME, 1)
        camera.set_robot(0, place_scene(track, look, np.random.default_rng(0)), look.rig())
        tiles.append(_titled(camera.render(pose)[0], name))
    tiles.append(_titled(coloured(camera.segment(pose)[0]), "classes"))
    tiles += [np.full_like(tiles[0], 255)] * (-len(tiles) % 4)
    return np.vstack([np.hstack(tiles[k : k + 4]) for k in range(0, len(tiles), 4)])


def _panel(track: Track) -> np.ndarray:
    ground = paint_track(track, NOMINAL).rgb
    scale = (PANEL_PX - 40) / max(ground.shape[:2])
    small = cv2.resize(ground, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    panel = np.full((PANEL_PX, PANEL_PX, 3), 255, np.uint8)
    top, left = (PANEL_PX + 24 - small.shape[0]) // 2, (PANEL_PX - small.shape[1]) // 2
    panel[top : top + small.shape[0], left : left + small.shape[1]] = small
    text = f"{track.name}: {track.length_m:.0f} m, {track.width_m:.0f} m wide"
    _write(panel, text, 10, 18)
    return panel


def _titled(frame: np.ndarray, title: str) -> np.ndarray:
    large = np.asarray(cv2.resize(frame, (240, 180), interpolation=cv2.INTER_AREA))
    strip = np.full((20, large.shape[1], 3), 255, np.uint8)
    _write(strip, title, 6, 14)
    return np.vstack((strip, large))


def _write(picture: np.ndarray, text: str, x_px: int, y_px: int) -> None:
    cv2.putText(
        picture, text, (x_px, y_px), cv2.FONT_HERSHEY_SIMPLEX, 0.42, (0, 0, 0), 1, cv2.LINE_AA
    )


def main(arguments: list[str] | None = None) -> int:
    """Write tracks.png and track_looks.png; exit status 2 for wrong input."""
    parser = OneLineParser(prog="python -m sim_pybullet.show_tracks", description=__doc__)
    parser.add_argument("--out", type=Path, required=True, help="folder of the two pictures")
    parser.add_argument("--track", nargs="*", default=[], help="else all shipped ones")
    parser.add_argument("--look", default="tracks", help="a folder of looks, or one look")
    options = parser.parse_args(arguments)
    return answer("show_tracks", lambda: draw(options))


def draw(options: argparse.Namespace) -> None:
    """Write the sheets asked for; DuckpilotError for wrong input."""
    expect_writable(options.out / "tracks.png", options.out / "track_looks.png")
    tracks = [load_track(name) for name in options.track or shipped_tracks()]
    files = looks_of(options.look)
    looks = [load_look_sampler(file)(np.random.default_rng(0)) for file in files]
    write_picture(options.out / "tracks.png", from_above(tracks))
    sheet = frames_of_looks(tracks[0], [file.stem for file in files], looks)
    write_picture(options.out / "track_looks.png", sheet)


if __name__ == "__main__":
    sys.exit(main())
