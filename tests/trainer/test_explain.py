from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

from robot.contract import PolicyContract
from robot.errors import ContractError
from trainer.algorithms import build_policy
from trainer.config import preset
from trainer.explain import Explainer, explain, fuse, overlay, pictures, share_on
from trainer.export import export_network
from trainer.networks import GreedyNetwork


@pytest.fixture
def model(tmp_path: Path) -> Path:
    torch.manual_seed(0)
    config = preset("lane", "dueling", "fast")
    contract = PolicyContract("lane", "dueling", config.image)
    export_network(GreedyNetwork(build_policy(config)), contract, tmp_path / "model.onnx")
    return tmp_path / "model.onnx"


def test_attention_is_a_map_of_the_picture(model: Path) -> None:
    images = np.random.default_rng(0).integers(0, 256, (3, 40, 80, 3), dtype=np.uint8)
    attention = Explainer(model).attention(images)
    assert attention.shape == (3, 40, 80)
    assert attention.min() >= 0.0
    assert attention.max() <= 1.0
    assert not np.array_equal(attention[0], attention[1])


def test_the_network_still_sees_what_the_torch_layers_see(model: Path) -> None:
    """The maps are made of the very activations of the exported network's convolutions."""
    torch.manual_seed(0)
    network = GreedyNetwork(build_policy(preset("lane", "dueling", "fast")))
    image = np.random.default_rng(1).integers(0, 256, (1, 40, 80, 3), dtype=np.uint8)
    pixels = torch.from_numpy(image).float().permute(0, 3, 1, 2) / 255.0
    means = []
    with torch.no_grad():
        for layer in network.features.convolutions:
            pixels = layer(pixels)
            if isinstance(layer, torch.nn.ReLU):
                means.append(pixels.mean(dim=1)[0].numpy())
    expected = fuse(means, (40, 80))
    assert np.allclose(Explainer(model).attention(image)[0], expected, atol=1e-4)


def test_layers_multiply_so_that_only_what_all_see_lights_up() -> None:
    first, last = np.zeros((8, 16), np.float32), np.zeros((2, 4), np.float32)
    first[:, 8:], last[:, 3] = 1.0, 1.0
    fused = fuse([first, last], (8, 16))
    assert fused[:, 14:].min() > 0.9
    assert fused[:, :8].max() == 0.0


def test_share_is_one_by_chance_and_more_on_what_is_looked_at() -> None:
    mask = np.zeros((10, 10), bool)
    mask[:, :2] = True
    assert share_on(np.ones((10, 10), np.float32), mask) == pytest.approx(1.0)
    assert share_on(mask.astype(np.float32), mask) == pytest.approx(5.0)


def test_overlay_is_yellow_where_attention_is() -> None:
    attention = np.zeros((4, 4), np.float32)
    attention[0, 0] = 1.0
    shown = overlay(np.full((4, 4, 3), 128, np.uint8), attention)
    red, green, blue = shown[0, 0].astype(int)
    assert min(red, green) > blue
    assert shown[3, 3, 2] > shown[3, 3, 0]


def test_a_folder_of_pictures_is_explained(model: Path, tmp_path: Path) -> None:
    folder = tmp_path / "pictures"
    folder.mkdir()
    for k in range(2):
        cv2.imwrite(str(folder / f"{k}.png"), np.full((48, 64, 3), 60 * k, np.uint8))
    shown = list(explain(model, pictures(folder)))
    assert [picture.shape for picture in shown] == [(160, 640, 3)] * 2


def test_what_is_no_policy_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.onnx").write_bytes(b"nothing")
    with pytest.raises(ContractError):
        Explainer(tmp_path / "a.onnx")
