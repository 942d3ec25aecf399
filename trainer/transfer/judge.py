"""How good a translator sim-to-real is, told without a network that learned anything.

Two figures, since either alone is easily had: how far its colours are from photographs', and how
much of the painted lines is where it was. Compare figures of the same folders and size only.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from robot.inference.policy import OnnxTranslator
from trainer.transfer.pictures import load_paint, load_pictures

LANE_OVERLAP = 0.85  # of the lines in picture and translation: what a translation must keep
_SHARES = np.linspace(0.0, 1.0, 101)
_FLOOR_SHARE = 0.98  # of a pixel that must be white or yellow paint, or road
_LEAST_CONTRAST = 25.0  # grey levels between paint and road, below which nothing is a line


def judge(translator: OnnxTranslator, sim: Sequence[Path], real: Sequence[Path]) -> dict[str, Any]:
    """``--json`` of ``translate judge``: distances to photographs, and the lines kept.

    ``sim`` are collections from the simulator, best none that it was trained with.
    """
    image = translator.contract.image
    simulated, photographs = (load_pictures(paths, image) for paths in (sim, real))
    made, shown, folder = translator(simulated.images), photographs.images, simulated.folder
    paint, others = load_paint(simulated, image), shown[min(1, len(shown) - 1) :: 2]
    return {
        "translator": str(translator.path),
        "pictures": len(simulated.images),
        "photographs": len(shown),
        "colours_before": colour_distance(simulated.images, shown),
        "colours_after": colour_distance(made, shown),
        "colours_apart": colour_distance(shown[::2], others),  # photographs from each other
        "lanes_kept": lanes_kept(simulated.images, folder, paint, made),
    }


def lanes_kept(
    pictures: np.ndarray, folder: np.ndarray, paint: np.ndarray, made: np.ndarray
) -> float:
    """How much of the lines of simulated pictures (N, H, W, 3) uint8 is where it was.

    ``folder`` (N,) says where they come from, ``paint`` is as of `load_paint`, ``made`` of them
    like them. In the collection where it is least; `LANE_OVERLAP` is due.
    """
    lines = [bright_lines(some, paint) for some in (made, pictures)]
    return min(overlap(*(some[folder == number] for some in lines)) for number in np.unique(folder))


def colour_distance(some: np.ndarray, others: np.ndarray) -> float:
    """How far the colours of pictures (N, H, W, 3) are from those of others [grey levels].

    The earth mover's distance of red, green and blue, each by itself, mean of the three.
    """
    quantiles = (np.quantile(each.reshape(-1, 3), _SHARES, axis=0) for each in (some, others))
    return float(np.abs(np.subtract(*quantiles)).mean())


def bright_lines(pictures: np.ndarray, paint: np.ndarray) -> np.ndarray:
    """(N, H, W) uint8, 1 on lines, told by brightness alone.

    On the floor that the simulator says is in sight there are two kinds of pixels, bright paint and
    dark road. Otsu's threshold (1979) parts them in each picture, on red and green: blue is what
    casts take away. ``paint`` (N, 4, H, W), as of `load_paint`, says only where to look.
    """
    masks = np.zeros(pictures.shape[:3], np.uint8)
    shares = paint.astype(np.float32) / 255.0
    floors = shares[:, 0] + shares[:, 1] + shares[:, 3] >= _FLOOR_SHARE
    for mask, light, floor in zip(masks, pictures[..., :2].mean(-1), floors, strict=True):
        seen = np.round(light[floor]).astype(np.uint8)
        if not len(seen):
            continue
        level, _ = cv2.threshold(seen, 0, 255, cv2.THRESH_BINARY + cv2.THRESH_OTSU)
        bright = seen > level
        both = bright.any() and not bright.all()
        if both and seen[bright].mean() - seen[~bright].mean() > _LEAST_CONTRAST:
            mask[floor] = light[floor] > level
    return masks


def overlap(found: np.ndarray, expected: np.ndarray) -> float:
    """Intersection over union of all line pixels of masks (N, H, W), whatever their colour."""
    both = ((found > 0) & (expected > 0)).sum()
    either = ((found > 0) | (expected > 0)).sum()
    return float(both / either) if either else 1.0
