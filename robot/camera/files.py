"""Pictures from and to files: one, a folder of them, or a video."""

from pathlib import Path
from typing import Iterator, List, Union

import numpy as np

from robot.errors import ConfigError
from robot.output import write_bytes

PICTURES = (".png", ".jpg", ".jpeg", ".bmp", ".webp", ".ppm", ".tif", ".tiff")
OTHERS = (".heic", ".heif", ".avif", ".gif")  # that some OpenCV reads; else they are told of
VIDEOS = (".mp4", ".avi", ".mkv", ".mov")


def play(path: Union[str, Path]) -> Iterator[np.ndarray]:
    """The pictures at a path, one by one, (H, W, 3) uint8 RGB; ConfigError where there are none."""
    path = Path(path)
    if path.is_dir():
        return (read_picture(file) for file in picture_files(path))
    if path.suffix.lower() in VIDEOS and path.is_file():
        import cv2

        capture = cv2.VideoCapture(str(path))
        if not capture.isOpened():
            raise ConfigError(f"{path}: expected a video, got a file that OpenCV cannot play")
        frames = iter(capture.read, (False, None))  # good or not, and the picture
        return (np.ascontiguousarray(picture[..., ::-1]) for _, picture in frames)
    told = f"{path}: expected a folder of pictures or a video ({', '.join(VIDEOS)}), got "
    raise ConfigError(f"{told}{'another file' if path.exists() else 'no such path'}")


def picture_files(folder: Path) -> List[Path]:
    """The pictures of a folder and of the folders in it, by name; ConfigError: there are none."""
    wanted = f"pictures ({', '.join(PICTURES)})"
    if not folder.is_dir():
        got = "a file; give the folder that it lies in" if folder.exists() else "no such folder"
        raise ConfigError(f"{folder}: expected a folder of {wanted}, got {got}")
    found = (path for path in folder.rglob("*") if path.suffix.lower() in PICTURES + OTHERS)
    files = sorted(path for path in found if path.is_file())
    if not any(path.suffix.lower() in PICTURES for path in files):
        raise ConfigError(f"{folder}: expected {wanted}, got none")
    return files


def read_picture(path: Path) -> np.ndarray:
    """A picture file as (H, W, 3) uint8 RGB. ConfigError: it is no picture."""
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
    except cv2.error:  # of more pixels than it takes
        picture = None
    finally:
        log.setLogLevel(level)
    if picture is None:
        raise ConfigError(f"{path}: expected a picture, got a file that OpenCV cannot read")
    return np.ascontiguousarray(picture[..., ::-1])


def write_png(path: Path, picture: np.ndarray) -> None:
    """Write a picture (H, W, 3) uint8 RGB as PNG; ConfigError without a place for it."""
    import cv2

    write_bytes(path, cv2.imencode(".png", picture[..., ::-1])[1].tobytes())
