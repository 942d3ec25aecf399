"""Pictures for the localizer: a camera, a video file, or a folder of pictures."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Callable, Iterator, NamedTuple, Union

import numpy as np

from robot.errors import ConfigError, HardwareError
from robot.lens import Lens

PICTURES = (".png", ".jpg", ".jpeg", ".bmp")
MAX_GAP_S = 2.0  # a camera that gives nothing for longer is taken to be dead


class Frame(NamedTuple):
    """One picture and when it was taken."""

    image: np.ndarray  # (H, W, 3) uint8 RGB
    t_capture_s: float  # monotonic


def read_picture(path: Union[str, Path]) -> np.ndarray:
    """A picture file as RGB (H, W, 3) uint8.

    Raises:
        ConfigError: absent, or not a picture.
    """
    import cv2

    image = cv2.imread(str(path), cv2.IMREAD_COLOR)
    if image is None:
        raise ConfigError(f"{path}: expected a picture ({', '.join(PICTURES)}), could not read one")
    return cv2.cvtColor(image, cv2.COLOR_BGR2RGB)


def open_source(
    source: str, lens: Lens, fps: float = 30.0, clock: Callable[[], float] = time.monotonic
) -> Iterator[Frame]:
    """Frames of a camera (its number), a video file, or a folder of pictures in order of name.

    A camera is set to the lens' picture size and ``fps`` and timed by ``clock``; pictures of a
    folder are ``1 / fps`` apart, those of a video as far as it says.

    Raises:
        ConfigError: there is no such file or folder.
        HardwareError: the camera cannot be opened, or went silent (on iteration).
    """
    if source.isdigit():
        return _camera(int(source), lens, fps, clock)
    path = Path(source)
    if path.is_dir():
        return _folder(path, fps)
    if path.is_file():
        return _video(path, fps)
    raise ConfigError(
        f"source {source!r}: expected a camera number, a video file or a folder of pictures"
    )


def _camera(number: int, lens: Lens, fps: float, clock: Callable[[], float]) -> Iterator[Frame]:
    import cv2

    capture = cv2.VideoCapture(number)
    if not capture.isOpened():
        raise HardwareError(
            f"camera {number}: cannot be opened; expected /dev/video{number} to exist and this "
            "user to be in the group video"
        )
    settings = (
        (cv2.CAP_PROP_FRAME_WIDTH, lens.width_px),
        (cv2.CAP_PROP_FRAME_HEIGHT, lens.height_px),
        (cv2.CAP_PROP_FPS, fps),
        (cv2.CAP_PROP_BUFFERSIZE, 1),
    )
    for setting, value in settings:
        capture.set(setting, value)
    heard_s = clock()
    try:
        while True:
            good = capture.grab()
            t_capture_s = clock()
            if good:
                good, image = capture.retrieve()
            if good:
                heard_s = t_capture_s
                yield Frame(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), t_capture_s)
            elif t_capture_s - heard_s > MAX_GAP_S:
                raise HardwareError(f"camera {number}: no picture for {MAX_GAP_S:g} s")
    finally:
        capture.release()


def _folder(path: Path, fps: float) -> Iterator[Frame]:
    files = sorted(f for f in path.iterdir() if f.suffix.lower() in PICTURES)
    if not files:
        raise ConfigError(f"{path}: expected pictures ({', '.join(PICTURES)}), found none")
    for i, file in enumerate(files):
        yield Frame(read_picture(file), i / fps)


def _video(path: Path, fps: float) -> Iterator[Frame]:
    import cv2

    capture = cv2.VideoCapture(str(path))
    rate = capture.get(cv2.CAP_PROP_FPS) or fps
    number = 0
    try:
        while True:
            good, image = capture.read()
            if not good:
                break
            yield Frame(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), number / rate)
            number += 1
    finally:
        capture.release()
    if number == 0:
        raise ConfigError(f"{path}: expected a video, could not read a picture from it")
