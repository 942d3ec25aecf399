"""What the models of the comparison look at: paper A's Figure 40, in the looks they are judged in.

On photographs it is `python -m trainer experiment real-photographs --only attention`.
"""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from robot.navigation.road_map import load_map
from sim_pybullet.classes import SemanticClass
from sim_pybullet.pool import LookPool
from sim_pybullet.randomise import load_look_sampler, looks_of
from trainer.experiments.photographs.attention import LabelledFrame, attention_sheet
from trainer.experiments.six_models import SixModelsOptions, models
from trainer.run import RunFolder, atomically
from trainer.translation.collect import snapshots

_SEED = 40


def judged_frames(options: SixModelsOptions, of_look: int = 1) -> list[LabelledFrame]:
    """Pictures of the map and looks that models are judged in, so many of each look.

    Raises:
        DuckpilotError: no such look or map.
    """
    road_maps = [load_map(options.test_map)]
    found = []
    for file in looks_of(options.look):
        rng = np.random.default_rng(_SEED)
        pool = LookPool(road_maps, load_look_sampler(file), rng, of_look)
        seen = snapshots(road_maps, pool, of_look, rng)
        for frame, label in zip(seen.frames, seen.labels, strict=True):
            lines = (label == SemanticClass.WHITE_LINE, label == SemanticClass.YELLOW_LINE)
            found.append(LabelledFrame(file.stem, frame, *lines))
    return found


def draw_attention(out: Path, options: SixModelsOptions, path: Path) -> None:
    """A PNG with a row for each look and a column for each navigator of the first seed."""
    navigators = [
        (f"{m.algorithm}, {m.variant}", RunFolder(m.run(out, "navigation")).onnx)
        for m in models(options)
        if m.seed == 0
    ]
    sheet = attention_sheet(navigators, judged_frames(options))
    with atomically(path) as temporary:
        temporary.write_bytes(cv2.imencode(".png", sheet[..., ::-1])[1].tobytes())
