"""How much more a policy looks at painted lines than at the rest of a photograph, site by site."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from robot.contract import FRAME_HEIGHT_PX, FRAME_WIDTH_PX, ImageSpec
from robot.inference.preprocess import preprocess
from trainer.judging.explain import Explainer, overlay, share_on
from trainer.transfer.annotations import load_annotated, load_annotations
from trainer.transfer.classes import RoadClass

SETS = {  # shipped annotations, and the folders of their photographs
    "duckietown": ("duckietown_dtcore_sites", "duckietown_udem"),
    "donkeycar": ("donkeycar_dashed_track",),
}
_SITES = {"226night": "226night", "226noon": "226noon", "icerink": "icerink", "r2_": "udem"}
_SHOWN_PX, _HEAD_PX = 160, 16  # width of a picture on the sheet, height of its title
_LEAST_PX = 3  # of a line in a policy's picture


@dataclass(frozen=True)
class LabelledFrame:
    """A photograph with the lines that a person drew on it."""

    site: str
    frame: np.ndarray  # (120, 160, 3) uint8 RGB
    white: np.ndarray  # (120, 160) bool
    yellow: np.ndarray


@dataclass(frozen=True)
class SiteAttention:
    """How many times more attention lies on lines than chance would put there (1 is chance)."""

    policy: str
    site: str
    photographs: int
    white: float  # mean over the photographs that show such a line; NaN if none does
    yellow: float
    influence_white: float  # the same, asked by covering patches
    influence_yellow: float


def labelled_frames(photographs: Path) -> list[LabelledFrame]:
    """All photographs with drawn polygons.

    Args:
        photographs: the folder that holds the sites' folders.

    Raises:
        ConfigError: a photograph is missing.
    """
    size = (FRAME_HEIGHT_PX, FRAME_WIDTH_PX)
    found = []
    for name, folders in SETS.items():
        annotations = load_annotations(name)
        here = photographs if len(folders) > 1 else photographs / folders[0]
        for half in load_annotated(annotations, here, size):
            for file, frame, truth in zip(half.names, half.frames, half.truth, strict=True):
                masks = (truth == RoadClass.WHITE_LINE, truth == RoadClass.YELLOW_LINE)
                found.append(LabelledFrame(_site(file, name), frame, *masks))
    return found


def attention_by_site(
    policy: str, model: Path, frames: Sequence[LabelledFrame]
) -> list[SiteAttention]:
    """One row for each site.

    Args:
        policy: its name in the table.
        model: an ONNX policy.
        frames: of all sites.

    Raises:
        ContractError: not a policy of ours.
    """
    explainer = Explainer(model)
    spec = explainer.contract.image
    shares: dict[str, list[list[float]]] = {}
    for labelled in frames:
        image = preprocess(labelled.frame, spec)
        maps = (explainer.attention(image[None])[0], explainer.influence(image))
        masks = [_seen(mask, spec) for mask in (labelled.white, labelled.yellow)]
        row = [
            share_on(seen, mask) if mask.sum() >= _LEAST_PX else np.nan
            for seen in maps
            for mask in masks
        ]
        shares.setdefault(labelled.site, []).append(row)
    return [
        SiteAttention(policy, site, len(rows), *_means(np.array(rows)))
        for site, rows in shares.items()
    ]


def attention_sheet(
    policies: Sequence[tuple[str, Path]], frames: Sequence[LabelledFrame], of_site: int = 1
) -> np.ndarray:
    """Figure 40 of paper A: some pictures of each site, and what each policy looks at in them.

    Args:
        policies: names and ONNX files.
        frames: of all sites.
        of_site: how many of each.

    Returns:
        RGB: a row for each picture, the picture first, then a column for each policy.
    """
    sites = dict.fromkeys(labelled.site for labelled in frames)
    chosen = [
        labelled for site in sites for labelled in [f for f in frames if f.site == site][:of_site]
    ]
    columns = []
    for k, (name, path) in enumerate(policies):
        explainer = Explainer(path)
        seen = np.stack([preprocess(each.frame, explainer.contract.image) for each in chosen])
        if k == 0:
            columns.append(_column("", seen))
        maps = explainer.attention(seen)
        columns.append(_column(name, [overlay(*pair) for pair in zip(seen, maps, strict=True)]))
    return np.hstack(columns)


def _column(title: str, pictures: Sequence[np.ndarray] | np.ndarray) -> np.ndarray:
    size = (_SHOWN_PX, round(_SHOWN_PX * pictures[0].shape[0] / pictures[0].shape[1]))
    head = np.full((_HEAD_PX, _SHOWN_PX, 3), 255, np.uint8)
    cv2.putText(head, title, (2, 11), cv2.FONT_HERSHEY_SIMPLEX, 0.36, (0, 0, 0), 1, cv2.LINE_AA)
    shown = [cv2.resize(picture, size, interpolation=cv2.INTER_NEAREST) for picture in pictures]
    return np.vstack([head, *shown])


def _means(rows: np.ndarray) -> tuple[float, ...]:
    known = np.isfinite(rows)
    sums = np.where(known, rows, 0.0).sum(0)
    counts = known.sum(0)
    return tuple(float(s / n) if n else np.nan for s, n in zip(sums, counts, strict=True))


def _seen(mask: np.ndarray, spec: ImageSpec) -> np.ndarray:
    """(H, W) bool of the policy's picture: pixels that are half line or more."""
    size = (spec.width_px, spec.height_px)
    small = cv2.resize(mask.astype(np.float32), size, interpolation=cv2.INTER_AREA)
    return np.asarray(small[spec.crop_top_px :] >= 0.5)


def _site(file: str, otherwise: str) -> str:
    for prefix, site in _SITES.items():
        if re.match(prefix, file):
            return site
    return otherwise
