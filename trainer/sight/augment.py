"""What pictures might have looked like: under other lights, over the robot's own front, or spoiled.

Cheap changes of finished pictures; what they show of the road stays the same, or is gone.
"""

import cv2
import numpy as np

from trainer.relit import relit
from trainer.sight.pictures import FREE, KIND, LINE, LINE_FIGURE, ROAD, Pictures

_SPOILED, _RELIT, _TINGED, _GLINTING, _FRONTED = 0.12, 0.5, 0.15, 0.2, 0.25  # shares of a batch
_TINGE = 0.1  # what light of another colour leaves of one colour, at least
_FRONT = 0.25  # of the picture's height that the robot's own front hides at most, in the middle
_HIDDEN_M = 0.2  # nearer red lines may be behind it
_SHIFT_PX, _STRETCH = (0.8, 3.0), 0.05  # to the side and up; of the size


def drawn(given: Pictures, count: int, rng: np.random.Generator, moved: bool = False) -> Pictures:
    """Images and labels of so many pictures, each changed by chance, ``moved`` ones always."""
    chosen = rng.integers(len(given.labels), size=count)
    images, labels = given.images[chosen], given.labels[chosen].copy()
    if moved:
        images = np.stack([shifted(each, rng) for each in images])
    chances = rng.random((count, 5)) < (_RELIT, _TINGED, _GLINTING, _FRONTED, _SPOILED)
    for i, (light, tinge, glint, front, spoil) in enumerate(chances.tolist()):
        if light:
            images[i] = relit(images[i], rng)
        if glint:
            images[i] = glinting(images[i], rng)
        if front:
            images[i] = fronted(images[i], rng)
            if labels[i, LINE_FIGURE] < _HIDDEN_M:
                labels[i, [LINE_FIGURE, LINE]] = np.nan, -1.0
        if tinge:
            images[i] = tinged(images[i], rng)
        if spoil:
            images[i] = spoiled(images[i], rng)
            labels[i, : FREE + 1], labels[i, LINE : KIND + 1] = np.nan, -1.0
            labels[i, ROAD] = 0.0
    return Pictures(images, labels)


def tinged(image: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Under lamps that lack one colour."""
    gain = np.ones(3)
    gain[rng.integers(3)] = rng.uniform(_TINGE, 1.0)
    return np.asarray((image * gain).astype(np.uint8))


def glinting(image: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Lamps that a smooth floor mirrors: soft spots, mostly upright."""
    height, width = image.shape[:2]
    count = int(rng.integers(1, 7))
    wide, high = rng.uniform((0.5, 0.5), (3.0, 9.0), (count, 2)).T[..., None]
    at = rng.uniform((0.0, 0.0), (width, height), (count, 2)).T[..., None]
    across = np.exp(-0.5 * ((np.arange(width) - at[0]) / wide) ** 2)
    down = np.exp(-0.5 * ((np.arange(height) - at[1]) / high) ** 2)
    light = (rng.uniform(20.0, 180.0, (count, 1)) * down).T @ across
    return np.clip(image + light[..., None] * rng.uniform(0.8, 1.0, 3), 0.0, 255.0).astype(np.uint8)


def fronted(image: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """The robot's own bumper or hood below, as a low camera sees it; lamps may shine on it."""
    height, width = image.shape[:2]
    x = np.linspace(-1.0, 1.0, width) - rng.uniform(-0.2, 0.2)
    rise = rng.uniform(0.0, _FRONT) + rng.uniform(-0.15, 0.35) * x**2
    edge = height * (1.0 - rise)  # its row in each column
    top = max(0, int(edge.min()) - 1)
    depth = np.arange(top, height)[:, None] + 0.5 - edge
    shade = rng.uniform(0.0, 255.0) + rng.normal(0.0, 12.0, 3)
    shade = shade + (rng.uniform(-8.0, 8.0) * depth)[..., None]
    if rng.random() < 0.4:
        shade = shade + 120.0 * np.abs(x[:, None]) ** 3 * rng.uniform(0.0, 1.0, 3)
    part, found = np.clip(depth + 0.5, 0.0, 1.0)[..., None], image.copy()
    found[top:] = np.clip((1.0 - part) * image[top:] + part * shade, 0.0, 255.0)
    return found


def spoiled(image: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A picture (H, W, 3) uint8 that shows no road: upside down, covered, or noise.

    One with left and right exchanged shows a road: as from the oncoming lane.
    """
    way = int(rng.integers(4))
    if way < 2:
        return np.asarray(cv2.flip(image, way - 1))
    if way == 2:  # a hand before the lens: next to nothing of the picture is left
        size = image.shape[1::-1]
        small = cv2.resize(image, (8, 4), interpolation=cv2.INTER_AREA).astype(np.float32)
        blurred = cv2.resize(cv2.GaussianBlur(small, (0, 0), float(rng.uniform(1, 3))), size)
        dark = blurred * rng.uniform(0.02, 0.6) + rng.normal(0, rng.uniform(0, 8), image.shape)
        return np.clip(dark, 0, 255).astype(np.uint8)
    grain = rng.normal(rng.uniform(0, 255), rng.uniform(0, 80), image.shape).astype(np.float32)
    if rng.random() < 0.5:
        grain = 3.0 * cv2.GaussianBlur(grain, (0, 0), float(rng.uniform(0.5, 4)))
    return np.clip(grain, 0, 255).astype(np.uint8)


def shifted(image: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A picture (H, W, 3) uint8 as by a camera that is mounted a little otherwise."""
    size = np.array(image.shape[1::-1])
    zoom = 1.0 + rng.uniform(-_STRETCH, _STRETCH)
    aside, down = rng.uniform(-1.0, 1.0, 2) * _SHIFT_PX + (1.0 - zoom) * size / 2.0
    move = np.array(((zoom, 0.0, aside), (0.0, zoom, down)))
    return cv2.warpAffine(image, move, size.tolist(), borderMode=cv2.BORDER_REPLICATE)
