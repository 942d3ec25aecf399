"""A translator between the world and the policy, in training and in evaluation."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from robot.contract import ImageSpec
from robot.errors import ContractError
from robot.inference.policy import TranslatorContract
from tests.robot.tiny_onnx import write_translator
from trainer.cli import main
from trainer.envs import make_env
from trainer.experiments.records import named_policies
from trainer.options import TrainOptions
from trainer.presets import preset
from trainer.training.train import judged
from trainer.transfer.cli import ParseOptions
from trainer.transfer.labelled import ROAD
from trainer.transfer.parser import Parser
from trainer.transfer.pix2pix import FRAME


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


@pytest.fixture
def parser_file(tmp_path: Path) -> Path:
    torch.manual_seed(0)
    Parser(ParseOptions(size=(30, 40))).export("untaught", tmp_path / "parser.onnx")
    return tmp_path / "parser.onnx"


def test_who_sees_what_a_parser_sees_takes_its_pictures(parser_file: Path, negative: Path) -> None:
    asked = TrainOptions("track", "ppo", "debug", translate=str(parser_file), style="cruise")
    config = asked.config()
    assert config.image == ImageSpec(40, 30)
    for run, tracks in ((config, 2), (judged(config), 1)):
        env = make_env(run, 2, 0)
        seen = np.asarray(env.reset())
        assert len(env.world.task.road_maps) == tracks
        colours = {tuple(pixel) for pixel in seen.reshape(-1, 3).tolist()}
        assert colours <= set(ROAD.colours)
        env.close()
    lane = preset("lane", "ddqn", "debug")
    assert (
        TrainOptions("lane", preset="debug", translate=str(negative)).config().image == lane.image
    )


def test_cruises_through_a_parser_and_is_asked_about_reality_through_it(
    tmp_path: Path, parser_file: Path
) -> None:
    run, through = tmp_path / "run", ["--translate", str(parser_file)]
    words = ["train", "--out", str(run), "--preset", "debug", "--algo", "ppo", "--task", "track"]
    words += ["--style", "cruise", "--map", "karting", "--steps", "128", *through]
    assert main(words) == 0
    model = run / "model.onnx"
    assert main(["evaluate", "--model", str(model), "--episodes", "1", *through]) == 0
    ((name, seed, policy),) = named_policies([f"ours={model}+{parser_file}"])
    assert (name, seed) == ("ours", 0)
    frames = np.random.default_rng(0).integers(0, 256, (5, *FRAME, 3), dtype=np.uint8)
    seen = policy.see(frames)
    assert seen.shape == (5, 30, 40, 3)
    assert {tuple(pixel) for pixel in seen.reshape(-1, 3).tolist()} <= set(ROAD.colours)
    assert policy.turns(np.tile(seen, 4)).shape == (5,)
    with pytest.raises(ContractError, match="expected a translator of the policy's pictures"):
        named_policies([f"ours={Path('robot/models/track_ppo.onnx').resolve()}+{parser_file}"])
