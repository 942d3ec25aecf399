import itertools
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from robot.contract import ImageSpec
from robot.inference.translator import TranslatorContract
from tools.translation_cost import ALGORITHMS, main, measure
from trainer.presets import preset
from trainer.transfer.export import export_translator


def translator(path: Path, image: ImageSpec) -> str:
    export_translator(
        torch.nn.Identity(), TranslatorContract("cyclegan", "sim-to-real", image), path
    )
    return str(path)


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_both_trainings_take_turns_under_the_same_clock(algorithm: str, tmp_path: Path) -> None:
    config = replace(preset("lane", algorithm, "debug"), seed=1)
    ticks = itertools.count()
    cost = measure(
        config, translator(tmp_path / "t.onnx", config.image), 2, 16, lambda: float(next(ticks))
    )
    assert next(ticks) == 2 * 2 * 3  # begun and ended: with and without, two turns and one before
    assert cost.ratio == 1.0
    assert cost.with_ms == cost.without_ms > 0.0
    assert (cost.algorithm, cost.robots) == (algorithm, config.learn.robots)


def test_a_translator_for_other_pictures_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = translator(tmp_path / "other.onnx", ImageSpec())
    report = tmp_path / "cost.json"
    assert main(["--translator", other, "--turns", "1", "--json", str(report)]) == 2
    assert "expected a translator of the policy's pictures" in (capsys.readouterr().err)
    assert not report.exists()
