"""Coloured blobs: HSV mask, connected components, centroids to a fraction of a pixel."""

from typing import List, NamedTuple, Tuple

import cv2
import numpy as np

from localizer_node.calibration import Colour

ALIKE = (6.0, 25.0, 60.0)  # of OpenCV's hue, saturation and value: a floor of one colour
SPARSE = 5  # pixels apart, a floor is asked for its colour


class Blob(NamedTuple):
    """One connected component; coordinates in the picture that was searched."""

    centre_px: Tuple[float, float]  # centroid (u, v), edge pixels in proportion
    covariance_px2: Tuple[float, float, float]  # uu, uv, vv of the filled outline
    area_px: float  # of the filled outline


def mask_of(hsv: np.ndarray, colour: Colour) -> np.ndarray:
    """255 where OpenCV's HSV (H, W, 3), hue in half degrees, has this colour, (H, W) uint8."""
    low, high = colour.hue_min_deg / 2.0, colour.hue_max_deg / 2.0
    floor = (colour.saturation_min * 255.0, colour.value_min * 255.0)
    if low <= high:
        return cv2.inRange(hsv, (low, *floor), (high, 255, 255))
    below = cv2.inRange(hsv, (0, *floor), (high, 255, 255))
    return cv2.bitwise_or(below, cv2.inRange(hsv, (low, *floor), (180, 255, 255)))


def blobs(image: np.ndarray, mask: np.ndarray, least_px: float, most_px: float) -> List[Blob]:
    """The components of a mask of an RGB picture (H, W, 3), of such areas, largest first.

    What is larger is floor: there, what has another colour than most of it counts.
    """
    # Of both levels, outlines and holes: on a floor of its own colour a board lies in a hole.
    outlines, levels = cv2.findContours(mask, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    found: List[Blob] = []
    floor = np.zeros_like(mask)
    for k, outline in enumerate(outlines):
        u, v, width, height = cv2.boundingRect(outline)
        if width * height < least_px or levels[0, k, 3] >= 0:
            continue
        if cv2.contourArea(outline) <= most_px:
            found.append(_blob(image, mask, outline, (u, v, u + width, v + height)))
        else:  # without its holes, in which others lie
            cv2.drawContours(floor, outlines, k, 255, cv2.FILLED, hierarchy=levels, maxLevel=1)
    if (floor := cv2.bitwise_and(floor, mask))[::SPARSE, ::SPARSE].any():
        found += blobs(image, _other(image, floor), least_px, most_px)
    return sorted((b for b in found if b.area_px >= least_px), key=lambda blob: -blob.area_px)


def _other(image: np.ndarray, floor: np.ndarray) -> np.ndarray:
    """The part of a mask that has not the hue, saturation and value of most of it."""
    hsv = cv2.cvtColor(np.ascontiguousarray(image), cv2.COLOR_RGB2HSV)
    some = hsv[::SPARSE, ::SPARSE][floor[::SPARSE, ::SPARSE] > 0].astype(float)
    middle = np.median(some, axis=0)
    away = np.abs(some - middle)
    off = np.array(ALIKE) + 4.0 * np.median(away, axis=0)
    off = np.maximum(off, off * np.median((away / off).max(axis=1)) + 1.0)  # half of it, at least
    return cv2.bitwise_and(floor, cv2.bitwise_not(cv2.inRange(hsv, middle - off, middle + off)))


def _blob(
    image: np.ndarray, mask: np.ndarray, outline: np.ndarray, rect: Tuple[int, int, int, int]
) -> Blob:
    u0, v0 = max(rect[0] - 1, 0), max(rect[1] - 1, 0)
    window = np.s_[v0 : rect[3] + 1, u0 : rect[2] + 1]
    filled = np.zeros(mask[window].shape, np.uint8)
    cv2.drawContours(filled, [outline], -1, 255, cv2.FILLED, offset=(-u0, -v0))
    shape = cv2.moments(filled, binaryImage=True)
    weight = _coverage(image[window], mask[window], filled)
    v, u = np.indices(weight.shape)
    total = max(float(weight.sum()), 1e-9)
    centre = (u0 + float((u * weight).sum()) / total, v0 + float((v * weight).sum()) / total)
    area = shape["m00"]
    return Blob(centre, (shape["mu20"] / area, shape["mu11"] / area, shape["mu02"] / area), area)


def _coverage(image: np.ndarray, mask: np.ndarray, filled: np.ndarray) -> np.ndarray:
    """How much of each pixel the blob covers; float32, 0 outside the blob. That is its chroma
    over the highest one near it: a shadow darkens both alike."""
    chroma = cv2.bitwise_and(image.max(axis=2) - image.min(axis=2), cv2.bitwise_and(mask, filled))
    highest = cv2.dilate(chroma, np.ones((5, 5), np.uint8))
    return chroma / np.maximum(highest, 1).astype(np.float32)
