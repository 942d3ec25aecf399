"""From a camera frame to the picture a policy sees: the same bytes in simulation and for real."""

import numpy as np

from robot.contract import FRAME_HEIGHT_PX, FRAME_WIDTH_PX, ImageSpec
from robot.errors import ContractError

FRAME_SHAPE = (FRAME_HEIGHT_PX, FRAME_WIDTH_PX, 3)


def check_frame(frame: np.ndarray) -> None:
    """ContractError unless ``frame`` is (120, 160, 3) uint8."""
    shape, dtype = getattr(frame, "shape", None), getattr(frame, "dtype", None)
    if shape != FRAME_SHAPE or dtype != np.uint8:
        told = "resize the camera's picture to the frame size first"
        raise ContractError(f"frame: expected {FRAME_SHAPE} uint8 RGB, got {shape} {dtype}; {told}")


def preprocess(frame: np.ndarray, spec: ImageSpec) -> np.ndarray:
    """A frame (120, 160, 3) uint8 RGB -> ``spec.shape`` uint8 RGB, in a fresh contiguous array.

    Resized by pixel area (no aliasing, and the same bytes from every OpenCV 4), then the top
    ``spec.crop_top_px`` rows are cut off. ContractError: ``frame`` is not a camera frame.
    """
    check_frame(frame)
    if (spec.width_px, spec.height_px) != (FRAME_WIDTH_PX, FRAME_HEIGHT_PX):
        import cv2

        frame = cv2.resize(frame, (spec.width_px, spec.height_px), interpolation=cv2.INTER_AREA)
    return frame[spec.crop_top_px :].copy()


def preprocess_batch(frames: np.ndarray, spec: ImageSpec) -> np.ndarray:
    """Frames (N, 120, 160, 3) uint8 RGB -> (N, *spec.shape) uint8 RGB, each as ``preprocess``."""
    pictures = np.empty((len(frames), *spec.shape), dtype=np.uint8)
    for picture, frame in zip(pictures, frames):
        picture[...] = preprocess(frame, spec)
    return pictures
