"""What colour things have in the pictures, and what the sensor does to them."""

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from robot.contract import ImageSpec
from sim_pybullet.rendering.ray_camera import RayCamera
from sim_pybullet.scene import Scene
from trainer.twin.eye import far, rig_of

KINDS = ("white", "yellow", "outside", "asphalt")
LEAST_PIXELS = 150  # by which a colour is known
PURE = 0.97
_CLIPPED = 253  # beyond that a sensor tells nothing
_BURNT = 0.9  # of the pixels of a colour that burns out do so
STILL_LEVELS = 12.0  # greatest mean change between pictures of a robot that stands


class Colours(NamedTuple):
    """As the pictures have them."""

    rgb: dict[str, np.ndarray]  # (3,) of those of ``KINDS`` that were seen; above 255: burnt out
    noise: float | None  # grey levels; None where the robot never stood


def members(drawn: np.ndarray) -> dict[str, np.ndarray]:
    """(F, H, W) bool for each kind: the pixels that show nothing else; of pictures of cover."""
    share = drawn.astype(float) / 255.0
    rest = 1.0 - share.sum(axis=-1)
    masks = {kind: share[..., k] > PURE for k, kind in enumerate(KINDS[:3])}
    masks["outside"][:, : drawn.shape[1] // 2] = False  # far away it may be anything
    return {**masks, "asphalt": rest > PURE}


def seen_from(scene: Scene, values: np.ndarray, poses: np.ndarray) -> np.ndarray:
    """(F, 120, 160, 3) uint8: what a camera, see `rig_of`, sees of a scene from poses (F, 3)."""
    camera = RayCamera(ImageSpec(), 1)
    camera.set_robot(0, scene, rig_of(values))
    return np.concatenate([camera.render(pose[None]) for pose in poses])


def fit_colours(
    images: np.ndarray, drawn: np.ndarray, shade: float, still: Sequence[np.ndarray]
) -> Colours:
    """The colours of pictures (F, 120, 160, 3) whose cover is known, by a lens's shade of corners.

    ``still``: pictures that followed each other while the robot stood.
    """
    masks = members(drawn)
    levels = {kind: images[mask].astype(float) for kind, mask in masks.items()}
    radii = {kind: np.broadcast_to(far(), mask.shape)[mask] for kind, mask in masks.items()}
    seen = [kind for kind in KINDS if len(levels[kind]) >= LEAST_PIXELS]
    rgb = {kind: _unshaded(levels[kind], 1.0 - shade * radii[kind][:, None]) for kind in seen}
    return Colours(rgb, _noise(still))


def _unshaded(levels: np.ndarray, light: np.ndarray) -> np.ndarray:
    """(3,) of levels (N, 3) in so much light (N, 1); burnt out it is what burns out nearly all."""
    whole = levels / light
    burnt = np.median(levels, axis=0) >= _CLIPPED
    return np.where(burnt, np.quantile(whole, _BURNT, axis=0), np.median(whole, axis=0))


def _noise(still: Sequence[np.ndarray]) -> float | None:
    changes = [a.astype(float) - b for a, b in itertools.pairwise(still)]
    changes = [c[(c != 0).any(axis=-1)] for c in changes if np.abs(c).mean() < STILL_LEVELS]
    if len(changes) < 5:
        return None
    both = np.concatenate([c.ravel() for c in changes])
    return float(1.4826 * np.median(np.abs(both)) / np.sqrt(2.0)) if len(both) > 1000 else 0.0
