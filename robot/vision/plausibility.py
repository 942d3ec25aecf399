"""Whether pictures show anything, move when the wheels do, and show the road where it must lie.

The first two questions are asked of grey means of 8 x 8 pixels, where a sensor's noise has all but
vanished. A picture shows something when its coarse structure is strong enough, and is found again
in the next picture: noise of any strength and grain is never the same twice. A picture has moved
when enough of it differs by more than noise from the last one that had moved. The third question
is that of `robot.vision.road_fit`.
"""

import math
from typing import NamedTuple, Optional, Tuple

import numpy as np

from robot.camera.source import Frame
from robot.geometry import STILL, Pose, WheelSpeeds
from robot.vision.road_fit import RoadFit, Verdict

BLOCK_PX = 8
COLUMNS, ROWS = 20, 15  # blocks of a frame
WIDE = 5  # blocks; structure is what stands out from its surroundings of this size
# How far structure may shift between two decisions: a hard turn moves it by two and a half blocks.
SHIFT_COLUMNS, SHIFT_ROWS = 4, 1
# Grey levels of structure that two pictures share. The darkest of 9,000 honest simulated frames had
# 3.0; a covered lens has 1.1 at most, with noise of 40 levels.
STRUCTURE = 2.0
# Correlation of structure at the best shift. Honest frames have 0.65 to 1 (one in a hundred below
# 0.5, never for long), noise of any grain up to 8 pixels less than 0.35.
SAME = 0.4
CHANGED_SHARE = 0.1  # of the blocks, before a picture has moved
CHANGED_LEVELS = 2.6  # grey levels; JPEG alone moves a block by up to 1.6
CHANGED_NOISE = 5.2  # standard deviations of a block's noise
_MAD = 1.4826  # standard deviations of a normal distribution in its median absolute deviation
_HIGH_PASS = math.sqrt(8.0 / 9.0)  # what a pixel's noise keeps when its 3 x 3 mean is taken off


def blocks(plane: np.ndarray) -> np.ndarray:
    """The means (15, 20) of a plane's blocks."""
    import cv2

    return np.asarray(cv2.resize(plane, (COLUMNS, ROWS), interpolation=cv2.INTER_AREA))


def in_grey(image: np.ndarray) -> Tuple[np.ndarray, np.ndarray]:
    """A frame (H, W, 3) uint8 RGB as grey levels (H, W) float32, and its structure (15, 20): what
    of the blocks stands out from its surroundings.
    """
    import cv2

    plane = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY).astype(np.float32)
    coarse = blocks(plane)
    return plane, coarse - cv2.blur(coarse, (WIDE, WIDE), borderType=cv2.BORDER_REFLECT)


def shows_something(before: np.ndarray, now: np.ndarray) -> bool:
    """Whether two structures after one another share enough, shifted or not."""
    import cv2

    core = now[SHIFT_ROWS : ROWS - SHIFT_ROWS, SHIFT_COLUMNS : COLUMNS - SHIFT_COLUMNS]
    shared = float(cv2.matchTemplate(before, core, cv2.TM_CCOEFF).max()) / core.size
    if shared < STRUCTURE**2:
        return False
    return float(cv2.matchTemplate(before, core, cv2.TM_CCOEFF_NORMED).max()) >= SAME


def has_moved(before: np.ndarray, now: np.ndarray) -> bool:
    """Whether a grey picture (H, W) differs from another by more than noise and brightness."""
    import cv2

    change = now - before
    change -= np.median(change)
    rough = np.abs(change - cv2.blur(change, (3, 3)))
    noise = _MAD * float(np.median(rough)) / _HIGH_PASS / BLOCK_PX
    least = max(CHANGED_NOISE * noise, CHANGED_LEVELS)
    return float((np.abs(blocks(change)) > least).mean()) >= CHANGED_SHARE


class Sight(NamedTuple):
    """What may be wrong with the pictures; see `robot.safety.gates.Inputs`."""

    blind_s: float = 0.0
    still_s: float = 0.0
    wrong: str = ""


class PictureDoubts:
    """Looks at every new frame once, by the caller's clock; ``road`` says where roads must lie."""

    def __init__(self, road: Optional[RoadFit] = None) -> None:
        self._road = road
        self._verdict = Verdict(road.readings if road else ())
        self._wrong = ""
        self._sequence: Optional[int] = None
        self._structure: Optional[np.ndarray] = None  # of the newest frame
        self._moved: Optional[np.ndarray] = None  # the last frame that had moved, in grey
        self._seen_s = -math.inf  # when a frame last showed something
        self._moved_s = -math.inf

    def look(
        self, frame: Optional[Frame], pose: Optional[Pose], wheels: WheelSpeeds, now_s: float
    ) -> Sight:
        """What the newest frame tells; None while none has come.

        ``pose`` is where the robot believes to be, if anything tells it; ``wheels`` turn now [m/s].
        """
        if frame is not None and frame.sequence != self._sequence:
            self._sequence = frame.sequence
            before = self._structure
            plane, self._structure = in_grey(frame.image)
            if before is not None and shows_something(before, self._structure):
                self._seen_s = now_s
            if self._moved is None or has_moved(self._moved, plane):
                self._moved, self._moved_s = plane, now_s
            if wheels != STILL:
                self._judge(frame, pose)
        if wheels == STILL:  # it may see a picture that stands, and may be carried elsewhere
            self._moved, self._moved_s, self._wrong = None, now_s, ""
            self._verdict.forget()
        return Sight(now_s - self._seen_s, now_s - self._moved_s, self._wrong)

    def _judge(self, frame: Frame, pose: Optional[Pose]) -> None:
        fits = None if self._road is None else self._road.fits(frame.image, pose)
        if fits is not None:
            seems = self._verdict.add(fits)
            self._wrong = f"the road lies in the picture as if that were {seems}" if seems else ""
