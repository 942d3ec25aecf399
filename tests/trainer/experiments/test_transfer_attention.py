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


def test_every_look_is_shown_from_the_same_place_with_its_lines() -> None:
    frames = judged_frames(replace(OPTIONS, look="reality"))
    assert [each.site for each in frames] == ["hall", "lab", "night", "noon", "rink"]
    for each in frames:
        lines = each.white | each.yellow
        assert lines.any()
        assert not (each.white & each.yellow).any()
        light = each.frame.astype(int).sum(-1)
        assert light[lines].mean() > light[~lines].mean()


def test_the_sheet_has_a_column_for_each_way_of_transfer(tmp_path: Path) -> None:
    options = replace(OPTIONS, look="nominal")
    for model in models(options):
        folder = model.run(tmp_path, "navigation")
        folder.mkdir()
        copyfile(f"robot/models/nav_{model.algorithm}.onnx", RunFolder(folder).onnx)
    draw_attention(tmp_path, options, tmp_path / "attention.png")
    sheet = cv2.imread(str(tmp_path / "attention.png"))
    assert sheet.shape == (16 + 80, 160 * (1 + 4), 3)  # two algorithms, two ways without CycleGAN
    picture, dueling, ppo, again, _ = (sheet[16:, 160 * k : 160 * (k + 1)] for k in range(5))
    np.testing.assert_array_equal(dueling, again)
    assert (dueling != ppo).any()
    assert (dueling != picture).any()
