"""Pictures as a video that every browser plays."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

import numpy as np


def write_mp4(path: Path, frames: Iterable[np.ndarray], frames_per_s: float) -> None:
    """Encode frames (H, W, 3) uint8 RGB as H.264; the file appears under its name when whole."""
    import imageio_ffmpeg

    partial = path.with_name(f".{path.stem}.partial.mp4")
    writer = None
    try:
        for frame in frames:
            if writer is None:
                size = (frame.shape[1], frame.shape[0])
                writer = imageio_ffmpeg.write_frames(
                    str(partial), size, fps=frames_per_s, quality=7, macro_block_size=2
                )
                writer.send(None)
            writer.send(np.ascontiguousarray(frame).tobytes())
    finally:
        if writer is not None:
            writer.close()
    if writer is None:
        raise ValueError(f"{path}: expected at least one frame, got none")
    os.replace(partial, path)
