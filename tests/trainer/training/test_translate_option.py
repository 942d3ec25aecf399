"""A translator between the world and the policy, in training and in evaluation."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from robot.contract import ImageSpec
from robot.errors import ContractError
from robot.inference.translator import TranslatorContract
from tests.robot.tiny_onnx import write_translator
from trainer.cli import main
from trainer.envs import make_env
from trainer.presets import preset


@pytest.fixture
def negative(tmp_path: Path) -> Path:
    image = preset("lane", "ddqn", "debug").image
    contract = TranslatorContract("cyclegan", "sim-to-real", image)
    return write_translator(tmp_path / "negative.onnx", contract)


def test_every_picture_of_a_run_is_translated(negative: Path) -> None:
    config = preset("lane", "ddqn", "debug")
    pictures = []
    for through in (None, str(negative)):
        env = make_env(replace(config, translate=through), 2, 0)
        first = env.reset()
        later, *_ = env.step(np.zeros(2, dtype=int))
        env.close()
        pictures.append(np.stack((first, later)))
    np.testing.assert_array_equal(pictures[1], 255 - pictures[0])


def test_a_translator_of_other_pictures_is_refused(negative: Path) -> None:
    config = replace(preset("lane", "ddqn", "paper"), translate=str(negative))
    assert config.image == ImageSpec()
    with pytest.raises(ContractError, match="expected a translator of the policy's pictures"):
        make_env(config, 1, 0)


def test_trains_and_evaluates_through_a_translator(tmp_path: Path, negative: Path) -> None:
    run, report = tmp_path / "run", tmp_path / "report.json"
    through = ["--translate", str(negative)]
    words = ["train", "--out", str(run), "--preset", "debug", "--algo", "ddqn", "--steps", "64"]
    assert main([*words, *through]) == 0
    assert f"translate: {negative}" in (run / "config.yaml").read_text()
    words = ["evaluate", "--model", str(run / "model.onnx"), "--episodes", "2"]
    assert main([*words, *through, "--json", str(report)]) == 0
    assert json.loads(report.read_text())["inputs"]["translate"] == str(negative)
