"""From a camera frame to the picture a policy sees: the same bytes in simulation and for real."""

from __future__ import annotations

import numpy as np

from robot.contract import FRAME_HEIGHT_PX, FRAME_WIDTH_PX, ImageSpec
from robot.errors import ContractError

FRAME_SHAPE = (FRAME_HEIGHT_PX, FRAME_WIDTH_PX, 3)


def check_frame(frame: np.ndarray) -> None:
    """Refuse what is no camera frame.

    Raises:
        ContractError: ``frame`` is not (120, 160, 3) uint8.
    """
    _check(frame, FRAME_SHAPE, "frame")


def preprocess(frame: np.ndarray, spec: ImageSpec) -> np.ndarray:
    """A frame (120, 160, 3) uint8 RGB -> ``spec.shape`` uint8 RGB, in a fresh contiguous array.

    Resized by pixel area (no aliasing, and the same bytes from every OpenCV 4), then the top
    ``spec.crop_top_px`` rows are cut off.

    Raises:
        ContractError: ``frame`` is not a camera frame.
    """
    check_frame(frame)
    return _resize_and_crop(frame, spec)


def preprocess_batch(frames: np.ndarray, spec: ImageSpec) -> np.ndarray:
    """Frames (N, 120, 160, 3) uint8 RGB -> (N, *spec.shape) uint8 RGB, each as ``preprocess``.

    Raises:
        ContractError: ``frames`` is not a batch of camera frames.
    """
    _check(frames, ("N", *FRAME_SHAPE), "frames")
    pictures = np.empty((len(frames), *spec.shape), dtype=np.uint8)
    for picture, frame in zip(pictures, frames):
        picture[...] = _resize_and_crop(frame, spec)
    return pictures


def _resize_and_crop(frame: np.ndarray, spec: ImageSpec) -> np.ndarray:
    if (spec.width_px, spec.height_px) != (FRAME_WIDTH_PX, FRAME_HEIGHT_PX):
        import cv2

        frame = cv2.resize(frame, (spec.width_px, spec.height_px), interpolation=cv2.INTER_AREA)
    return frame[spec.crop_top_px :].copy()


def _check(array: np.ndarray, expected: tuple, name: str) -> None:
    shape = getattr(array, "shape", None)
    dtype = getattr(array, "dtype", None)
    if (
        dtype != np.uint8
        or shape is None
        or len(shape) != len(expected)
        or not _fits(shape, expected)
    ):
        got = f"{shape} {dtype}" if shape is not None else type(array).__name__
        sizes = ", ".join(str(size) for size in expected)
        raise ContractError(
            f"{name}: expected ({sizes}) uint8 RGB, got {got}; "
            "resize the camera's picture to the frame size first"
        )


def _fits(shape: tuple, expected: tuple) -> bool:
    return all(want in (size, "N") for size, want in zip(shape, expected))
