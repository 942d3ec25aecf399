"""A folder of pictures or a video file as a camera, by the clock."""

from __future__ import annotations

from pathlib import Path
from typing import Callable, List, Optional, Protocol, Union

import numpy as np

from robot.camera.source import Frame, fit_to_frame
from robot.errors import ConfigError

PICTURES = (".png", ".jpg", ".jpeg", ".bmp", ".webp", ".ppm", ".tif", ".tiff")
VIDEOS = (".mp4", ".avi", ".mkv", ".mov")


class Reel(Protocol):
    """Pictures by number."""

    def picture(self, index: int) -> Optional[np.ndarray]:
        """(H, W, 3) uint8 RGB; None past the end. Numbers never go back."""


class ReplayCamera:
    """Plays at a given rate from the first ``read`` on; stays on the last picture at the end.

    Its last frame then grows old, so that a robot that drives by it stops.

    Args:
        path: a folder of pictures, in the order of their names, or a video file.
        fps: pictures a second.
        clock: monotonic time [s].

    Raises:
        ConfigError: there is nothing to play.
    """

    def __init__(self, path: Union[str, Path], fps: float, clock: Callable[[], float]) -> None:
        if not fps > 0.0:
            raise ConfigError(f"fps: expected a positive number, got {fps}")
        self._reel = open_reel(path)
        self._fps = fps
        self._clock = clock
        self._started_s: Optional[float] = None
        self._frame: Optional[Frame] = None

    def read(self) -> Optional[Frame]:
        """The picture of this moment."""
        now_s = self._clock()
        if self._started_s is None:
            self._started_s = now_s
        index = int((now_s - self._started_s) * self._fps)
        if self._frame is None or index > self._frame.sequence:
            picture = self._reel.picture(index)
            if picture is not None:
                taken_s = self._started_s + index / self._fps
                self._frame = Frame(fit_to_frame(picture), index, taken_s)
        return self._frame


def open_reel(path: Union[str, Path]) -> Reel:
    """The pictures at a path.

    Raises:
        ConfigError: no such path, no pictures in the folder, or a file that is no video.
    """
    path = Path(path)
    if path.is_dir():
        return _Folder(picture_files(path))
    if path.suffix.lower() in VIDEOS and path.is_file():
        return _Video(path)
    raise ConfigError(
        f"{path}: expected a folder of pictures or a video ({', '.join(VIDEOS)}), got "
        f"{'another file' if path.exists() else 'no such path'}"
    )


def picture_files(folder: Path) -> List[Path]:
    """The pictures of a folder and of the folders in it, by name.

    Raises:
        ConfigError: it is no folder, or holds none.
    """
    if not folder.is_dir():
        got = "a file; give the folder that it lies in" if folder.exists() else "no such folder"
        raise ConfigError(f"{folder}: expected a folder of pictures, got {got}")
    found = (path for path in folder.rglob("*") if path.suffix.lower() in PICTURES)
    files = sorted(path for path in found if path.is_file())
    if not files:
        raise ConfigError(f"{folder}: expected pictures ({', '.join(PICTURES)}), got none")
    return files


def read_picture(path: Path) -> np.ndarray:
    """A picture file as (H, W, 3) uint8 RGB.

    Raises:
        ConfigError: it is no picture.
    """
    import cv2

    try:
        data = np.fromfile(str(path), np.uint8)
    except OSError as error:
        raise ConfigError(f"{path}: expected a picture, got: {error.strerror}") from error
    log = getattr(cv2.utils, "logging", cv2)  # where it was before OpenCV 4.12 or so
    level = log.getLogLevel()
    log.setLogLevel(0)  # OpenCV's own words about a damaged picture, beside ours
    try:
        picture = cv2.imdecode(data, cv2.IMREAD_COLOR) if len(data) else None
    finally:
        log.setLogLevel(level)
    if picture is None:
        raise ConfigError(f"{path}: expected a picture, got a file that OpenCV cannot read")
    return np.ascontiguousarray(picture[..., ::-1])


class _Folder:
    def __init__(self, files: List[Path]) -> None:
        self._files = files

    def picture(self, index: int) -> Optional[np.ndarray]:
        return read_picture(self._files[index]) if index < len(self._files) else None


class _Video:
    def __init__(self, path: Path) -> None:
        import cv2

        self._capture = cv2.VideoCapture(str(path))
        self._next = 0
        if not self._capture.isOpened():
            raise ConfigError(f"{path}: expected a video, got a file that OpenCV cannot play")

    def picture(self, index: int) -> Optional[np.ndarray]:
        while self._next <= index:
            if not self._capture.grab():
                return None
            self._next += 1
        good, picture = self._capture.retrieve()
        return np.ascontiguousarray(picture[..., ::-1]) if good else None
