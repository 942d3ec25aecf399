"""Policies from elsewhere become ONNX files that the robot takes."""

import json
from pathlib import Path
from typing import Any

import cv2
import gymnasium
import numpy as np
import pytest
import torch
import yaml
from gymnasium import spaces
from stable_baselines3 import A2C, DQN, PPO, SAC, TD3
from torch import nn

import sim_pybullet  # noqa: F401  (registers the environments)
from robot.cli import main as robot
from robot.contract import ImageSpec
from robot.inference.policy import OnnxPolicy
from robot.inference.preprocess import preprocess
from trainer.cli import main

PICTURE = spaces.Box(0, 255, (36, 48, 3), np.uint8)
GUIDED = spaces.Dict({"image": PICTURE, "path": spaces.Box(-1.0, 1.0, (10,), np.float32)})
FIVE = spaces.Discrete(5)
WHEELS = spaces.Box(-1.0, 1.0, (2,), np.float32)
MOST_MPS = 0.3459  # a wheel's greatest speed in the table of five actions
CONTRACT = {
    "task": "lane",
    "algorithm": "mine",
    "image": {"width_px": 16, "height_px": 12, "crop_top_px": 4},
}


class Still(gymnasium.Env[Any, Any]):
    """Spaces without a world."""

    def __init__(self, seen: spaces.Space[Any], done: spaces.Space[Any]) -> None:
        self.observation_space, self.action_space = seen, done

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed)
        return self.observation_space.sample(), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        return self.observation_space.sample(), 0.0, False, False, {}


class Small(nn.Module):
    """Eight rows of sixteen pixels to so many values."""

    def __init__(self, actions: int = 5) -> None:
        super().__init__()
        self.line = nn.Linear(8 * 16 * 3, actions)

    def forward(self, image: torch.Tensor) -> torch.Tensor:
        return self.line(image.float().flatten(1) / 255.0)


class Guided(Small):
    """Takes a path, too."""

    def forward(self, image: torch.Tensor, path: torch.Tensor) -> torch.Tensor:  # type: ignore[override]
        return super().forward(image) + path.sum(dim=1, keepdim=True)


def wide() -> nn.Module:
    return Small(7)


def write(folder: Path, **changes: Any) -> str:
    path = folder / "contract.yaml"
    path.write_text(yaml.safe_dump({**CONTRACT, **changes}))
    return str(path)


def pictures(folder: Path, count: int = 6) -> Path:
    (folder / "pictures").mkdir()
    rng = np.random.default_rng(1)
    for k in range(count):
        frame = cv2.resize(rng.integers(0, 256, (6, 8, 3), np.uint8), (160, 120))
        cv2.imwrite(str(folder / "pictures" / f"{k}.png"), frame)
    return folder / "pictures"


def test_a_ppo_that_plain_stable_baselines3_trained_drives_the_robot(tmp_path: Path) -> None:
    env = gymnasium.make("duckpilot/LaneKeeping-v0", image=ImageSpec(48, 36), pool_size=1)
    model = PPO("CnnPolicy", env, n_steps=16, batch_size=16, n_epochs=1, seed=0, device="cpu")
    model.learn(32)
    model.save(tmp_path / "ppo.zip")
    env.close()
    assert main(["export", str(tmp_path / "ppo.zip")]) == 0
    images, out = pictures(tmp_path), tmp_path / "actions.json"
    call = ["infer", "--model", str(tmp_path / "ppo.onnx"), "--images", str(images)]
    assert robot([*call, "--json", str(out)]) == 0
    policy = OnnxPolicy(tmp_path / "ppo.onnx")
    assert (policy.contract.task, policy.contract.run) == ("lane", "ppo")
    for row in json.loads(out.read_text())["images"]:
        frame = cv2.imread(str(images / row["file"]))[..., ::-1]
        seen = preprocess(np.ascontiguousarray(frame), policy.contract.image)
        assert row["action"] == model.predict(seen, deterministic=True)[0]


@pytest.mark.parametrize("algorithm", [A2C, DQN])
@pytest.mark.parametrize("seen", [PICTURE, GUIDED], ids=["picture", "path"])
def test_choices_are_those_of_the_model(
    algorithm: Any, seen: spaces.Space[Any], tmp_path: Path
) -> None:
    kind = "CnnPolicy" if seen is PICTURE else "MultiInputPolicy"
    small = {"buffer_size": 10} if algorithm is DQN else {}
    model = algorithm(kind, Still(seen, FIVE), seed=0, device="cpu", **small)
    model.save(tmp_path / "m.zip")
    assert main(["export", str(tmp_path / "m.zip"), "--out", str(tmp_path / "out.onnx")]) == 0
    policy = OnnxPolicy(tmp_path / "out.onnx")
    assert policy.contract.task == ("lane" if seen is PICTURE else "navigation")
    for _ in range(8):
        sample = seen.sample()
        parts = sample if isinstance(sample, dict) else {"image": sample}
        ours = policy.values(*(part[None] for part in parts.values())).argmax(axis=1)[0]
        assert ours == model.predict(sample, deterministic=True)[0]


@pytest.mark.parametrize("algorithm", [PPO, SAC, TD3])
def test_continuous_wheel_speeds_become_the_nearest_of_a_table(
    algorithm: Any, tmp_path: Path
) -> None:
    small = {} if algorithm is PPO else {"buffer_size": 10}
    model = algorithm("CnnPolicy", Still(PICTURE, WHEELS), seed=0, device="cpu", **small)
    model.save(tmp_path / "m.zip")
    assert main(["export", str(tmp_path / "m.zip")]) == 0
    policy = OnnxPolicy(tmp_path / "m.onnx")
    table = np.array(policy.contract.actions)
    assert table.shape == (16, 2)
    assert (table[0] == 0.0).all(), "a stop is among them"
    for _ in range(4):
        picture = PICTURE.sample()
        wheels = MOST_MPS * model.predict(picture, deterministic=True)[0]
        nearest = np.linalg.norm(table - wheels, axis=1).argmin()
        assert policy.values(picture[None]).argmax(axis=1)[0] == nearest


def test_torchscript_and_a_module_by_name_reach_the_robot(tmp_path: Path) -> None:
    torch.manual_seed(0)
    network, images = Small().eval(), pictures(tmp_path)
    torch.jit.script(network).save(str(tmp_path / "net.pt"))
    named = "tests.trainer.test_outside:Small"
    for source, out in ((str(tmp_path / "net.pt"), "a.onnx"), (named, "b.onnx")):
        call = ["export", source, "--contract", write(tmp_path), "--out", str(tmp_path / out)]
        assert main(call) == 0
        call = ["infer", "--model", str(tmp_path / out), "--images", str(images)]
        assert robot([*call, "--json", str(tmp_path / "actions.json")]) == 0
    seen = np.random.default_rng(0).integers(0, 256, (3, 8, 16, 3), np.uint8)
    with torch.no_grad():
        expected = network(torch.from_numpy(seen)).numpy()
    values = OnnxPolicy(tmp_path / "a.onnx").values(seen)
    np.testing.assert_allclose(values, expected, atol=1e-4)


@pytest.mark.parametrize("told", [{"task": "navigation", "path_points": 10}, {"commands": 5}])
def test_a_module_may_take_a_path_or_the_last_commands(
    told: dict[str, Any], tmp_path: Path
) -> None:
    contract = write(tmp_path, **told)
    call = ["export", "tests.trainer.test_outside:Guided", "--contract", contract]
    assert main([*call, "--out", str(tmp_path / "guided.onnx")]) == 0
    found = OnnxPolicy(tmp_path / "guided.onnx").contract
    assert {name: getattr(found, name) for name in told} == told


@pytest.mark.parametrize(
    ("source", "changes", "said"),
    [
        ("wide", {}, "gives values (N, 5), N = 64, got (64, 7)"),
        ("Small", {"image": {"width_px": 20, "height_px": 12}}, "image (N, 12, 20, 3) uint8"),
        ("Guided", {}, "takes image (N, 8, 16, 3) uint8 and gives values"),
        ("Guided", {"path_points": 3}, "expected 0 or 10 path points, got 3"),
        ("Small", {"actions": [[0.1, 0.1]] * 5 + [[9.0, 9.0]]}, "values (N, 6)"),
        ("Small", {"actions": [[0.1, 0.1]] * 4 + [[9.0, 9.0]]}, "wheel speeds up to 0.346"),
        ("PICTURE", {}, "expected a torch.nn.Module, or what makes one, got Box"),
        ("nothing", {}, "expected MODULE:ATTRIBUTE"),
    ],
)
def test_what_does_not_fit_says_what_would(
    source: str,
    changes: dict[str, Any],
    said: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    out, contract = tmp_path / "out.onnx", write(tmp_path, **changes)
    named = f"tests.trainer.test_outside:{source}"
    assert main(["export", named, "--contract", contract, "--out", str(out)]) == 2
    told = capsys.readouterr().err
    assert said in told
    assert told.count("\n") == 1
    assert not out.exists()


@pytest.mark.parametrize(
    ("seen", "done", "said"),
    [
        (PICTURE, spaces.Discrete(7), "expected 5 actions, got 7"),
        (PICTURE, spaces.Box(-2.0, 2.0, (2,), np.float32), "Box(-1, 1, (2,))"),
        (spaces.Box(0, 255, (36, 50, 3), np.uint8), FIVE, "4:3 frame less its top rows"),
        (spaces.Box(-1.0, 1.0, (4,), np.float32), FIVE, "expected to see a picture (H, W, 3)"),
    ],
)
def test_a_policy_of_other_spaces_is_refused(
    seen: spaces.Space[Any],
    done: spaces.Space[Any],
    said: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    PPO("MlpPolicy", Still(seen, done), device="cpu").save(tmp_path / "m.zip")
    assert main(["export", str(tmp_path / "m.zip")]) == 2
    assert said in capsys.readouterr().err
    assert not (tmp_path / "m.onnx").exists()


def test_a_torch_file_without_a_contract_shows_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    torch.jit.script(Small()).save(str(tmp_path / "net.pt"))
    assert main(["export", str(tmp_path / "net.pt")]) == 2
    assert "such as: task: lane" in capsys.readouterr().err
