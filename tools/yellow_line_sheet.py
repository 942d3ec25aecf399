"""What `trainer.judging.yellow_line` sees, drawn over pictures: the mask, the dashes and the fitted
line.

    python -m tools.yellow_line_sheet --images photographs/ --out sheet.png

A red border is a robot left of the line, green right of it, grey no line found.
"""

from __future__ import annotations

import sys
from pathlib import Path

import cv2
import numpy as np

from robot.camera.replay import picture_files, read_picture
from robot.camera.source import fit_to_frame
from robot.command_line import OneLineParser, answer
from robot.lens import DUCKIEBOT_LENS, CameraRig
from robot.output import expect_writable, write_png
from trainer.judging.yellow_dashes import DEFAULT, floor_table, yellow_mask
from trainer.judging.yellow_line import YellowLine, detect_yellow_line

TILE = (320, 240)  # [px]
COLUMNS = 4
MOST_TILES = 24
BORDER_PX = 4
MASK, LINE, DASH = (255, 0, 255), (40, 235, 90), (255, 60, 40)
BORDERS = {True: (230, 50, 50), False: (60, 190, 90), None: (120, 120, 120)}


def draw_line(frame: np.ndarray, line: YellowLine, rig: CameraRig) -> np.ndarray:
    """One frame (H, W, 3) uint8 RGB with what was found in it, as a tile."""
    height, width = frame.shape[:2]
    mask = yellow_mask(frame, floor_table(rig, width, height, DEFAULT.range_m))
    tile = cv2.resize(frame, TILE, interpolation=cv2.INTER_CUBIC)
    yellow = cv2.resize(mask.astype(np.uint8), TILE, interpolation=cv2.INTER_NEAREST) > 0
    tile[yellow] = tile[yellow] // 2 + np.array(MASK, np.uint8) // 2
    large = CameraRig(rig.lens.scaled(*TILE), rig.mount)
    if line.found:
        pixels = _pixels(large, np.array(line.line_m))
        cv2.polylines(tile, [pixels[:, None]], False, LINE, 2, cv2.LINE_AA)
        for x, y in _pixels(large, np.array([dash[:2] for dash in line.dashes])):
            cv2.circle(tile, (int(x), int(y)), 4, DASH, -1, cv2.LINE_AA)
    colour = BORDERS[line.crossed]
    cv2.rectangle(tile, (0, 0), (TILE[0] - 1, TILE[1] - 1), colour, BORDER_PX)
    return tile


def draw_sheet(frames: list[np.ndarray], rig: CameraRig) -> np.ndarray:
    """A contact sheet of frames (H, W, 3) uint8 RGB."""
    tiles = [draw_line(frame, detect_yellow_line(frame, rig), rig) for frame in frames]
    tiles += [np.zeros_like(tiles[0])] * (-len(tiles) % COLUMNS)
    rows = [np.hstack(tiles[i : i + COLUMNS]) for i in range(0, len(tiles), COLUMNS)]
    return np.vstack(rows)


def _pixels(rig: CameraRig, points_m: np.ndarray) -> np.ndarray:
    """Floor points (M, 2) [m] as whole pixels (K, 2), less those that the lens cannot show."""
    floor = np.concatenate((points_m, np.zeros((len(points_m), 1))), axis=1)
    pixels = rig.to_pixels(floor)
    return pixels[(np.abs(pixels) < 1e4).all(axis=1)].round().astype(np.int32)


def main(arguments: list[str] | None = None) -> int:
    """The command; returns its exit status."""
    parser = OneLineParser(
        prog="python -m tools.yellow_line_sheet",
        description=__doc__.splitlines()[0] if __doc__ else None,
    )
    parser.add_argument("--images", type=Path, required=True, help="a folder of pictures")
    parser.add_argument("--out", type=Path, required=True, help="PNG to write")
    options = parser.parse_args(arguments)

    def work() -> None:
        expect_writable(options.out)
        files = picture_files(options.images)
        chosen = np.linspace(0, len(files) - 1, min(MOST_TILES, len(files))).round().astype(int)
        frames = [fit_to_frame(read_picture(files[i])) for i in chosen]
        write_png(options.out, draw_sheet(frames, CameraRig(DUCKIEBOT_LENS)))

    return answer("tools.yellow_line_sheet", work)


if __name__ == "__main__":
    sys.exit(main())
