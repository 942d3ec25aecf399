"""The localizer: pictures of the overhead camera in, poses of the robots out."""

import logging
from typing import List, Optional, Tuple

import numpy as np

from localizer_node.calibration import Calibration
from localizer_node.detect import Detection, Detector
from localizer_node.track import Tracker
from robot.errors import ContractError
from robot.link.messages import Sighting

logger = logging.getLogger(__name__)
REPEAT_BYTES = 32  # two pictures that differ in no more are one; a sensor's noise changes most
REPEATS_TOLD = 5  # in a row, once


def check_picture(image: np.ndarray, calibration: Calibration) -> None:
    """ContractError for a picture of another size or kind than the calibration was made for."""
    expected = (calibration.lens.height_px, calibration.lens.width_px, 3)
    if image.shape != expected or image.dtype != np.uint8:
        raise ContractError(
            f"overhead picture: expected {expected} uint8 RGB, as calibrated, got {image.shape} "
            f"{image.dtype}; set the camera to this size or calibrate at the other"
        )


def is_repeat(image: np.ndarray, last: Optional[np.ndarray]) -> bool:
    """Whether a picture (H, W, 3) is the last one again, but for a few pixels.

    As of a camera or driver that hangs: the noise of one that lives differs, even at rest. What is
    the same but for fresh noise is beyond this; robots compare poses with their wheels' steps.
    """
    if last is None:
        return False
    if np.count_nonzero(image[::8, ::8] != last[::8, ::8]) > REPEAT_BYTES:
        return False
    return int(np.count_nonzero(image != last)) <= REPEAT_BYTES


def locate_frame(image: np.ndarray, calibration: Calibration) -> List[Detection]:
    """The robots in one RGB picture (H, W, 3) uint8, surest first; errors as ``check_picture``."""
    check_picture(image, calibration)
    return sorted(Detector(calibration).detect(image), key=lambda d: -d.confidence)


class Localizer:
    """Follows the robots from picture to picture; one that repeats the last tells no poses."""

    def __init__(self, calibration: Calibration) -> None:
        self.calibration = calibration
        self._repeats = 0  # pictures in a row that repeated the one before
        self._last: Optional[np.ndarray] = None
        self._detector, self._tracker = Detector(calibration), Tracker(calibration)

    def feed(self, image: np.ndarray, t_capture_s: float) -> Tuple[Sighting, ...]:
        """The robots in the next RGB picture, taken at ``t_capture_s`` by a monotonic clock.

        Each is told from its third picture on. ContractError: another size, or an earlier time.
        """
        check_picture(image, self.calibration)
        self._repeats = self._repeats + 1 if is_repeat(image, self._last) else 0
        if self._repeats == REPEATS_TOLD:
            logger.warning("the overhead camera repeats its picture; no poses until it goes on")
        self._last = image
        if self._repeats:
            return ()
        return self._tracker.update(self._detector.detect(image), t_capture_s)
