"""Pictures to calibrate with: from files, or taken now."""

from __future__ import annotations

from pathlib import Path
from typing import Iterator, List, Tuple

import numpy as np

from robot.bringup.person import Person
from robot.bringup.target import find_board
from robot.camera.newest import Stream
from robot.camera.replay import picture_files, read_picture
from robot.config import CameraConfig
from robot.errors import ConfigError
from robot.output import write_png
from robot.runtime.assemble import open_stream

SIZE_PX = (640, 480)  # four times a frame in each direction: corners are found four times as well
SETTLING = 15  # pictures until exposure and white balance have settled
WANTED = 20  # pictures of the board
FEWEST_NEW_PX = 25.0  # that the board must have moved since each picture that was kept


def take_picture(camera: CameraConfig) -> np.ndarray:
    """(480, 640, 3) uint8 RGB of now.

    Raises:
        HardwareError: the camera does not work.
        ConfigError: it is a replay.
    """
    stream = _open(camera)
    try:
        for _ in range(SETTLING):
            stream.grab()
        return stream.grab()
    finally:
        stream.close()


def boards_from_files(folder: Path) -> Tuple[List[np.ndarray], Tuple[int, int]]:
    """The board's corners in each picture that shows it, and the size of the pictures.

    Raises:
        ConfigError: no pictures, or of several sizes.
    """
    boards, sizes = [], set()
    for file in picture_files(folder):
        picture = read_picture(file)
        sizes.add((picture.shape[1], picture.shape[0]))
        corners = find_board(picture)
        if corners is not None:
            boards.append(corners)
    if len(sizes) > 1:
        raise ConfigError(f"{folder}: expected pictures of one size, got {sorted(sizes)}")
    return boards, sizes.pop()


def collect_boards(camera: CameraConfig, folder: Path, person: Person) -> None:
    """Keep a picture whenever the board is seen at a new place, until there are ``WANTED``.

    Raises:
        HardwareError: the camera does not work.
        ConfigError: it is a replay, or the folder cannot be written.
    """
    person.tell(f"Move the printed board through the whole picture, tilted; {WANTED} are kept.")
    stream = _open(camera)
    try:
        for count, picture in enumerate(new_boards(stream), 1):
            write_png(folder / f"board-{count:02d}.png", picture)
            person.tell(f"{count} of {WANTED}")
            if count == WANTED:
                return
    finally:
        stream.close()


def new_boards(stream: Stream) -> Iterator[np.ndarray]:
    """Those pictures of a stream in which the board is where it was in none before."""
    kept: List[np.ndarray] = []
    while True:
        picture = stream.grab()
        corners = find_board(picture)
        if corners is None:
            continue
        moves_px = [np.linalg.norm(corners - other, axis=-1).mean() for other in kept]
        if min(moves_px, default=FEWEST_NEW_PX) >= FEWEST_NEW_PX:
            kept.append(corners)
            yield picture


def _open(camera: CameraConfig) -> Stream:
    if camera.kind == "replay":
        raise ConfigError("camera: expected a real one, got a replay; give pictures instead")
    return open_stream(camera, SIZE_PX)
