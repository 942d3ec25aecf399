from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Optional

import numpy as np
import pytest

from robot.contract import Action, ImageSpec
from robot.errors import ContractError
from robot.inference.policy import (
    DIRECTIONS,
    PARSING,
    OnnxPolicy,
    OnnxTranslator,
    TranslatingPolicy,
    TranslatorContract,
    open_policy,
    open_translator,
)
from tests.robot.tiny_onnx import (
    FIXTURES,
    lane_contract,
    write_network,
    write_policy,
    write_translator,
)

SMALL = ImageSpec(16, 12, 4)


def contract(direction: Any = "real-to-sim") -> TranslatorContract:
    return TranslatorContract("cyclegan", direction, SMALL, run="r", trained_steps=3)


@pytest.fixture
def negative(tmp_path: Path) -> Path:
    return write_translator(tmp_path / "negative.onnx", contract())


class Witness:
    """A policy that keeps what it was shown."""

    contract = lane_contract()

    def values(self, images: np.ndarray, path: Optional[np.ndarray] = None) -> np.ndarray:
        self.seen, self.path = images, path
        return np.zeros((len(images), 5), np.float32)


def test_every_frame_of_a_stack_is_translated_in_its_place(negative: Path) -> None:
    witness, rng = Witness(), np.random.default_rng(0)
    height, width, _ = SMALL.shape
    stacks = rng.integers(0, 256, (3, height, width, 12)).astype(np.uint8)
    TranslatingPolicy(witness, OnnxTranslator(negative)).values(stacks)
    np.testing.assert_array_equal(witness.seen, 255 - stacks)


def test_translates_a_batch_into_a_fresh_one(negative: Path) -> None:
    translator = OnnxTranslator(negative)
    assert translator.contract == contract()
    pictures = np.random.default_rng(0).integers(0, 256, (5, *SMALL.shape), dtype=np.uint8)
    before = pictures.copy()
    translation = translator(pictures)
    np.testing.assert_array_equal(translation, 255 - before)
    np.testing.assert_array_equal(pictures, before)
    assert translator(pictures[:0]).shape == (0, *SMALL.shape)


@pytest.mark.parametrize("wrong", [(1, 8, 16), (1, 12, 16, 3), (8, 16, 3)])
def test_refuses_other_pictures(negative: Path, wrong: tuple) -> None:
    with pytest.raises(ContractError, match=r"expected \(N, 8, 16, 3\) uint8, got"):
        OnnxTranslator(negative)(np.zeros(wrong, np.uint8))


def test_refuses_what_does_not_fit_the_policy(negative: Path) -> None:
    with pytest.raises(ContractError, match="train one with the policy's preset"):
        open_translator(negative, ImageSpec())
    with pytest.raises(ContractError, match="export the other direction"):
        open_translator(negative, SMALL, "sim-to-real")


def test_a_parser_serves_either_way(tmp_path: Path) -> None:
    path = write_translator(tmp_path / "parser.onnx", contract(PARSING))
    for direction in (None, *DIRECTIONS):
        assert open_translator(path, SMALL, direction).contract.direction == PARSING


def test_refuses_a_policy_file_and_foreign_metadata(tmp_path: Path) -> None:
    policy = write_policy(tmp_path / "policy.onnx", lane_contract(image=SMALL))
    with pytest.raises(ContractError, match=r"got keys \['duckpilot'\]; make the translator"):
        OnnxTranslator(policy)
    key, network = TranslatorContract.METADATA_KEY, (FIXTURES / "lane.onnx").read_bytes()
    for text, said in (
        ("{", "Expecting property name"),
        (contract().to_json().replace('"method"', '"methode"'), "did you mean 'method'"),
        (contract("sim-to-reel").to_json(), "did you mean 'sim-to-real'"),
        (contract().to_json(), "expected outputs translation"),
    ):
        path = write_network(tmp_path / "t.onnx", network, {key: text})
        with pytest.raises(ContractError, match=said):
            OnnxTranslator(path)
    assert json.loads(contract().to_json())["image"]["crop_top_px"] == 4


def test_the_robots_policy_sees_the_translation(tmp_path: Path, negative: Path) -> None:
    model = write_policy(tmp_path / "policy.onnx", lane_contract(image=SMALL, score=1.0))
    seen = open_policy(model, negative)
    assert isinstance(seen, TranslatingPolicy)
    assert seen.contract == OnnxPolicy(model).contract
    cyan = np.full((1, *SMALL.shape), (0, 255, 255), np.uint8)
    assert seen.values(cyan).argmax(axis=1) == Action.LEFT  # it sees red
    assert OnnxPolicy(model).values(cyan).argmax(axis=1) != Action.LEFT
    wrong = write_translator(tmp_path / "wrong.onnx", contract("sim-to-real"))
    with pytest.raises(ContractError, match="expected a translator real-to-sim"):
        open_policy(model, wrong)
