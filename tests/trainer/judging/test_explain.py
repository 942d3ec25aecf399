from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

from robot.camera.files import read_picture
from robot.contract import PolicyContract
from robot.errors import ContractError
from robot.inference.policy import OnnxPolicy
from robot.navigation.path import lane_loop
from robot.navigation.road_map import load_map
from sim_pybullet.look import NOMINAL
from sim_pybullet.rendering.ray_camera import RayCamera
from sim_pybullet.scene import SemanticClass
from sim_pybullet.scenery.objects import build_scene
from trainer.cli import main
from trainer.export import export_network
from trainer.judging.explain import (
    Explainer,
    explain,
    fuse,
    open_explainer,
    overlay,
    pictures,
    sheet,
    write_explained,
)
from trainer.learners.networks import GreedyNetwork
from trainer.learners.policies import build_policy
from trainer.mp4 import write_mp4
from trainer.presets import preset
from trainer.run import RunFolder
from trainer.torch_file import save_torch

MODELS = Path(__file__).parents[3] / "robot" / "models"
SHIPPED = MODELS / "lane_dueling.onnx"


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("model") / "model.onnx"
    torch.manual_seed(0)
    config = preset("lane", "dueling", "fast")
    contract = PolicyContract("lane", "dueling", config.image)
    export_network(GreedyNetwork(build_policy(config)), contract, path)
    return path


def test_attention_is_a_map_of_the_picture(model: Path) -> None:
    images = np.random.default_rng(0).integers(0, 256, (3, 40, 80, 3), dtype=np.uint8)
    attention = Explainer(model).attention(images)
    assert attention.shape == (3, 40, 80)
    assert attention.min() >= 0.0
    assert attention.max() <= 1.0
    assert not np.array_equal(attention[0], attention[1])


def test_of_one_that_is_told_its_last_commands_it_is_as_at_rest() -> None:
    explainer = Explainer(MODELS / "lane_sight.onnx")
    images = np.random.default_rng(0).integers(0, 256, (2, 40, 80, 3), dtype=np.uint8)
    assert explainer.attention(images).shape == (2, 40, 80)
    values = explainer._run(["values"], images)[0]
    at_rest = OnnxPolicy(MODELS / "lane_sight.onnx").values(images, np.zeros((2, 10)))
    np.testing.assert_allclose(values, at_rest, atol=1e-4)


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


def share_on(attention: np.ndarray, mask: np.ndarray) -> float:
    """How many times more attention lies on ``mask`` (H, W) bool than its area gets by chance."""
    by_chance = float(attention.sum()) * float(mask.mean())
    return float(attention[mask].sum()) / by_chance if by_chance > 0.0 else 0.0


def test_share_is_one_by_chance_and_more_on_what_is_looked_at() -> None:
    mask = np.zeros((10, 10), bool)
    mask[:, :2] = True
    assert share_on(np.ones((10, 10), np.float32), mask) == pytest.approx(1.0)
    assert share_on(mask.astype(np.float32), mask) == pytest.approx(5.0)


def test_influence_is_where_the_values_depend_on_the_picture(model: Path) -> None:
    explainer = Explainer(model)
    image = np.random.default_rng(0).integers(0, 256, (40, 80, 3), dtype=np.uint8)
    influence = explainer.influence(image)
    assert influence.shape == (40, 80)
    assert influence.min() >= 0.0
    image[:, :60] = 128  # so that grey is what patches are covered with
    influence = explainer.influence(image)
    np.testing.assert_array_equal(influence[:, :60], 0.0)
    assert influence[:, 60:].max() == 1.0


@pytest.fixture(scope="module")
def views() -> tuple[np.ndarray, np.ndarray]:
    """Policy pictures (N, 40, 80, 3) and classes (N, 40, 80) from random places of `loop`."""
    rng, count, spec = np.random.default_rng(0), 24, Explainer(SHIPPED).contract.image
    road_map = load_map("loop")
    lane = lane_loop(road_map, outer=True)
    along = [lane.pose_at(s) for s in rng.uniform(0.0, lane.length_m, count)]
    poses = np.array(along) + rng.uniform(-1.0, 1.0, (count, 3)) * (0.02, 0.02, 0.2)
    camera, scene = RayCamera(spec, count), build_scene(road_map, NOMINAL, rng)
    for i in range(count):
        camera.set_robot(i, scene, NOMINAL.rig())
    return camera.render(poses), camera.segment(poses)


def test_the_shipped_policy_looks_at_the_lines(views: tuple[np.ndarray, np.ndarray]) -> None:
    """Features: lines get 3.2 times what their area would get by chance, white ones 4 times.

    Influence: 2 times on yellow lines, 4 times on white ones. This policy has learned in one look,
    in which white lines are enough: its features leave yellow out (0.4 times).
    """
    pictures, classes = views
    explainer = Explainer(SHIPPED)
    white, yellow = classes == SemanticClass.WHITE_LINE, classes == SemanticClass.YELLOW_LINE
    features = explainer.attention(pictures)
    influence = np.stack([explainer.influence(picture) for picture in pictures])
    assert share_on(features, white | yellow) > 2.5
    assert share_on(features, white) > 3.0
    assert share_on(features, classes == SemanticClass.ROAD) < 0.7
    assert share_on(influence, white) > 2.5
    assert share_on(influence, yellow) > 1.3
    assert share_on(influence, classes == SemanticClass.ROAD) < 0.8


@pytest.mark.parametrize("name", ["nav_ppo", "nav_dueling"])
def test_policies_of_many_looks_light_both_lines_up(
    name: str, views: tuple[np.ndarray, np.ndarray]
) -> None:
    """Paper A, Figure 27: with a good policy white and yellow lines light up."""
    pictures, classes = views
    explainer = Explainer(MODELS / f"{name}.onnx")
    features = explainer.attention(pictures)
    assert share_on(features, classes == SemanticClass.WHITE_LINE) > 2.0
    assert share_on(features, classes == SemanticClass.YELLOW_LINE) > 1.3
    assert share_on(features, classes == SemanticClass.ROAD) < 0.7
    influence = np.stack([explainer.influence(picture) for picture in pictures])
    assert share_on(influence, classes == SemanticClass.WHITE_LINE) > 2.5
    assert share_on(influence, classes == SemanticClass.YELLOW_LINE) > 2.5


def test_a_quantised_policy_looks_where_the_whole_one_does(
    views: tuple[np.ndarray, np.ndarray],
) -> None:
    pictures, _ = views
    whole, quantised = (
        Explainer(path).attention(pictures).ravel()
        for path in (SHIPPED, SHIPPED.with_name("lane_dueling_int8.onnx"))
    )
    assert np.corrcoef(whole, quantised)[0, 1] > 0.95


def test_overlay_is_yellow_where_attention_is() -> None:
    attention = np.zeros((4, 4), np.float32)
    attention[0, 0] = 1.0
    shown = overlay(np.full((4, 4, 3), 128, np.uint8), attention)
    red, green, blue = shown[0, 0].astype(int)
    assert min(red, green) > blue
    assert shown[3, 3, 2] > shown[3, 3, 0]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    folder = tmp_path / "pictures"
    folder.mkdir()
    for k in range(2):
        cv2.imwrite(str(folder / f"{k}.png"), np.full((48, 64, 3), 60 * k, np.uint8))
    return folder


def test_a_folder_or_a_picture_is_explained(
    model: Path, folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert write_explained(model, folder, tmp_path / "all") == 2
    assert capsys.readouterr().out == "", "the bar stands beside what is told"
    assert {path.name for path in (tmp_path / "all").iterdir()} == {
        "0_explained.png",
        "1_explained.png",
        "sheet.png",
    }
    assert read_picture(tmp_path / "all" / "0_explained.png").shape == (240, 960, 3)
    arguments = ["explain", "--model", str(model), "--images", str(folder / "1.png")]
    assert main([*arguments, "--out", str(tmp_path / "one")]) == 0
    assert len(list((tmp_path / "one").iterdir())) == 2


def test_a_video_is_explained_with_a_video(model: Path, tmp_path: Path) -> None:
    frames = [np.full((120, 160, 3), 20 * k, np.uint8) for k in range(11)]
    write_mp4(tmp_path / "drive.mp4", frames, 10.0)
    assert write_explained(model, tmp_path / "drive.mp4", tmp_path / "out") == 11
    explained = list(pictures(tmp_path / "out" / "drive_explained.mp4"))
    assert len(explained) == 11
    assert (tmp_path / "out" / "sheet.png").exists()


def test_a_checkpoint_looks_where_its_export_looks(tmp_path: Path) -> None:
    torch.manual_seed(1)
    run = RunFolder(tmp_path / "run")
    config = preset("navigation", "ppo", "debug")
    run.go_on(config)
    policy = build_policy(config)
    save_torch(run.best, policy.state_dict())
    torch.save({"policy": policy.state_dict()}, run.checkpoint.with_name("last.pt"))
    contract = PolicyContract("navigation", "ppo", config.image, path_points=10)
    export_network(GreedyNetwork(policy), contract, tmp_path / "model.onnx")
    images = np.random.default_rng(0).integers(0, 256, (2, *config.image.shape), dtype=np.uint8)
    expected = Explainer(tmp_path / "model.onnx").attention(images)
    for source in (run.best, run.path / "last.pt", run.path):
        found = open_explainer(source).attention(images)
        np.testing.assert_allclose(found, expected, atol=1e-5)


def test_wrong_sources_are_status_2(model: Path, folder: Path, tmp_path: Path) -> None:
    out = ["--out", str(tmp_path / "out")]
    assert main(["explain", "--model", str(model), "--images", str(tmp_path / "none"), *out]) == 2
    assert main(["explain", "--model", str(folder), "--images", str(folder), *out]) == 2
    run = RunFolder(tmp_path / "run")
    run.go_on(preset("lane", "ppo", "debug"))
    assert main(["explain", "--model", str(run.path), "--images", str(folder), *out]) == 2
    run.best.write_bytes(b"nothing")
    assert main(["explain", "--model", str(run.best), "--images", str(folder), *out]) == 2
    assert not (tmp_path / "out").exists()


def test_rows_that_the_policy_does_not_see_are_dark(model: Path) -> None:
    shown = explain(Explainer(model), np.full((120, 160, 3), 90, np.uint8))
    assert shown.shape == (240, 960, 3)
    np.testing.assert_array_equal(shown[:80, 320:], 30)
    assert shown[81:, 320:].mean() > 30
    np.testing.assert_array_equal(shown[:, :320], 90)


def test_a_sheet_shows_some_of_many() -> None:
    many = [np.full((240, 960, 3), k, np.uint8) for k in range(100)]
    assert sheet(many).shape == (16 * 150, 600, 3)
    assert sheet(many[:1]).shape == (150, 600, 3)


def test_what_is_no_policy_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.onnx").write_bytes(b"nothing")
    with pytest.raises(ContractError):
        Explainer(tmp_path / "a.onnx")
