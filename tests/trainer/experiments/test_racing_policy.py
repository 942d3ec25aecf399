import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import onnx
import pytest
import torch

from robot.errors import ContractError
from robot.inference.policy import SHIPPED_MODELS
from sim_pybullet.tasks.track_racing import RACING_ACTIONS
from trainer.cli import main
from trainer.experiments.records import STACK, SteeringPolicy, Turn, named_policies

HEIGHT, WIDTH = 12, 24


class SteerToLight(torch.nn.Module):
    """Values of the nine actions: the light on the side that an action steers to, newest frame."""

    def forward(self, image: torch.Tensor) -> torch.Tensor:
        newest = image[..., -3:].float().mean((1, 3))
        sides = torch.stack([part.mean(1) for part in newest.chunk(3, dim=1)], dim=1)
        side_of = [1 - int(steering) for steering, _ in RACING_ACTIONS]  # positive is to the left
        return 0.1 * sides[:, side_of]


def write_policy(
    path: Path,
    task: str = "track",
    actions: Sequence[tuple[float, float]] = RACING_ACTIONS,
    algorithm: str = "a3c",
    size: tuple[int, int] = (HEIGHT, WIDTH),
) -> None:
    height, width = size
    example = torch.zeros((2, height, width, 3 * STACK), dtype=torch.uint8)
    torch.onnx.export(
        SteerToLight(),
        (example,),
        str(path),
        dynamo=False,
        opset_version=17,
        input_names=["image"],
        output_names=["values"],
        dynamic_axes={"image": {0: "n"}, "values": {0: "n"}},
    )
    model = onnx.load(str(path))
    model.ir_version = 9
    contract = {
        "schema": 1,
        "task": task,
        "algorithm": algorithm,
        "frames": STACK,
        "image": {"width_px": width, "height_px": height + 4, "crop_top_px": 4},
        "actions": actions,
    }
    onnx.helper.set_model_props(model, {"duckpilot": json.dumps(contract)})
    onnx.save(model, str(path))


@pytest.fixture(scope="module")
def policy_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("policy") / "model.onnx"
    write_policy(path)
    return path


def test_a_policy_turns_to_where_its_actions_steer(policy_file: Path) -> None:
    policy = SteeringPolicy(policy_file)
    assert policy.image.shape == (HEIGHT, WIDTH, 3)
    stacks = np.zeros((3, HEIGHT, WIDTH, 3 * STACK), np.uint8)
    for turn in Turn:
        stacks[turn, :, 8 * turn : 8 * turn + 8] = 200
    assert policy.turns(stacks).tolist() == [Turn.LEFT, Turn.STRAIGHT, Turn.RIGHT]


def test_a_robots_policy_turns_to_where_its_slower_wheel_is(tmp_path: Path) -> None:
    wheels = [(0.1, 0.4), (0.4, 0.4), (0.4, 0.1)] * 3
    write_policy(tmp_path / "lane.onnx", task="lane", actions=wheels)
    policy = SteeringPolicy(tmp_path / "lane.onnx")
    stacks = np.zeros((1, HEIGHT, WIDTH, 3 * STACK), np.uint8)
    stacks[..., :8, :] = 200  # values for "left" of RACING_ACTIONS: numbers 1, 4 and 7
    assert policy.turns(stacks).tolist() == [Turn.STRAIGHT]


def test_who_is_told_its_last_commands_is_asked_as_at_rest() -> None:
    policy = SteeringPolicy(SHIPPED_MODELS / "lane_sight.onnx")
    newest = np.random.default_rng(0).integers(0, 256, (2, 40, 80, 3), np.uint8)
    assert set(policy.turns(np.tile(newest, STACK)).tolist()) <= set(Turn)


def test_probabilities_are_added_up_but_not_what_actions_are_worth(tmp_path: Path) -> None:
    """Six actions steer straight, each a little worse than the best of the three others."""
    straight_often = [(0.0, 0.0), (1.0, 0.0), (0.0, 0.0)] * 2 + [
        (0.0, 0.0),
        (-1.0, 0.0),
        (0.0, 0.0),
    ]
    stacks = np.full((1, HEIGHT, WIDTH, 3 * STACK), 100, np.uint8)
    stacks[..., :8, :] = 102
    for algorithm, turn in (("ppo", Turn.STRAIGHT), ("dueling", Turn.LEFT)):
        write_policy(tmp_path / "a.onnx", actions=straight_often, algorithm=algorithm)
        assert SteeringPolicy(tmp_path / "a.onnx").turns(stacks).tolist() == [turn]


@pytest.mark.parametrize(("light", "turn"), [(5, Turn.STRAIGHT), (10, Turn.LEFT)])
def test_who_turns_now_and_then_steers_by_how_often(
    light: int, turn: Turn, policy_file: Path
) -> None:
    """To the left with 45 % and 58 %, to the right with 27 % and 21 %: 5 and 11 of 30 degrees."""
    stacks = np.zeros((1, HEIGHT, WIDTH, 3 * STACK), np.uint8)
    stacks[:, :, :8] = light
    assert SteeringPolicy(policy_file).turns(stacks).tolist() == [turn]


def test_who_cannot_turn_is_refused(tmp_path: Path) -> None:
    write_policy(tmp_path / "lane.onnx", actions=[(0.0, 1.0)] * 9)
    with pytest.raises(ContractError, match="left, straight and right"):
        SteeringPolicy(tmp_path / "lane.onnx")


def test_a_policy_needs_a_name_and_each_counts(
    policy_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["experiment", "paper-b-accuracy", "--data", str(tmp_path)]
    command += ["--out", str(tmp_path / "out")]
    assert main([*command, "--policy", str(policy_file)]) == 2
    assert "expected name=model.onnx" in capsys.readouterr().err
    found = named_policies([f"ours={policy_file}", f"b-rl={policy_file}", f"ours={policy_file}"])
    assert [(name, seed) for name, seed, _ in found] == [("ours", 0), ("b-rl", 0), ("ours", 1)]
