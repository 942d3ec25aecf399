"""Pictures as a video that every browser plays."""

import os
from collections.abc import Generator, Iterable
from pathlib import Path

import cv2
import numpy as np


class Mp4:
    """A video while it is written, as H.264; it appears under its name when it is whole.

    Frames come at ``frames_per_s``; ``quality`` is 0 to 10; ``more`` options are ffmpeg's.
    """

    def __init__(
        self, path: Path, frames_per_s: float, quality: float = 7.0, more: tuple[str, ...] = ()
    ) -> None:
        self._path, self._partial = path, path.with_name(f".{path.stem}.partial.mp4")
        quick = ["-preset", "veryfast", *more]  # half the time, a tenth larger
        self._how = {"fps": frames_per_s, "quality": quality, "output_params": quick}
        self._writer: Generator[None, bytes | None, None] | None = None

    def add(self, frame: np.ndarray) -> None:
        """One more frame (H, W, 3) uint8 RGB, of the same even size as the others."""
        import imageio_ffmpeg

        if self._writer is None:
            file, size = str(self._partial), frame.shape[1::-1]
            self._writer = imageio_ffmpeg.write_frames(file, size, macro_block_size=2, **self._how)
            self._writer.send(None)
        self._writer.send(np.ascontiguousarray(frame).tobytes())

    def close(self) -> None:
        """Complete it, if it has a frame."""
        if self._writer is not None:
            self._writer.close()
            os.replace(self._partial, self._path)


def write_mp4(path: Path, frames: Iterable[np.ndarray], frames_per_s: float) -> None:
    """A video of these frames (H, W, 3) uint8 RGB; none without any."""
    video = Mp4(path, frames_per_s)
    for frame in frames:
        video.add(frame)
    video.close()


def enlarged(frame: np.ndarray, width_px: int = 480) -> np.ndarray:
    """A small picture (H, W, 3) uint8 at a width that can be watched, with even sides."""
    height_px = 2 * round(width_px * frame.shape[0] / frame.shape[1] / 2)
    return np.asarray(cv2.resize(frame, (width_px, height_px), interpolation=cv2.INTER_CUBIC))
