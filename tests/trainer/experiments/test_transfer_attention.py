from dataclasses import replace
from pathlib import Path
from shutil import copyfile

import cv2
import numpy as np

from trainer.experiments.six_models import (
    SixModelsOptions,
    draw_attention,
    judged_frames,
    models,
)
from trainer.run import RunFolder

OPTIONS = SixModelsOptions(seeds=2)


def test_every_look_is_shown_from_the_same_place() -> None:
    frames = judged_frames(replace(OPTIONS, look="reality"))
    assert frames.shape == (5, 120, 160, 3)
    colours = frames.mean((1, 2))
    assert len({tuple(colour) for colour in colours.round(1).tolist()}) == 5
    edges = [cv2.Canny(frame, 60, 180) > 0 for frame in frames]
    grown = [cv2.dilate(edge.astype(np.uint8), np.ones((9, 9), np.uint8)) > 0 for edge in edges]
    assert np.mean([grown[0][edge].mean() for edge in edges[1:]]) > 0.6


def test_the_sheet_has_a_column_for_each_way_of_transfer(tmp_path: Path) -> None:
    options = replace(OPTIONS, look="nominal")
    for model in models(options):
        folder = model.run(tmp_path, "navigation")
        folder.mkdir()
        copyfile(f"robot/models/nav_{model.algorithm}.onnx", RunFolder(folder).onnx)
    draw_attention(tmp_path, options, tmp_path / "attention.png")
    sheet = cv2.imread(str(tmp_path / "attention.png"))
    width = 160 + 4  # and a gap; two algorithms, two ways without CycleGAN
    assert sheet.shape == (16 + 80 + 4, width * (1 + 4), 3)
    picture, dueling, ppo, again, _ = (sheet[16:, width * k : width * (k + 1)] for k in range(5))
    np.testing.assert_array_equal(dueling, again)
    assert (dueling != ppo).any()
    assert (dueling != picture).any()
