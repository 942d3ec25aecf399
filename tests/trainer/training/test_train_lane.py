"""The command line in the real world, with networks too small to learn."""

import json
from pathlib import Path

import pytest

from robot.errors import ContractError
from robot.inference.policy import OnnxPolicy
from sim_pybullet.tasks.track_racing import RACING_ACTIONS
from tests.thorough import count
from trainer.cli import main
from trainer.judging.evaluate import open_policy
from trainer.run import RunFolder

FILES = ("config.yaml", "progress.csv", "curve.png", "checkpoint.pt", "model.onnx", "metrics.json")


@pytest.mark.parametrize("algorithm", ["ddqn", "a2c", "ppo", "dagger"][: count(2, 4)])
def test_debug_run_leaves_every_file(algorithm: str, tmp_path: Path) -> None:
    out = tmp_path / "run"
    arguments = ["train", "--algo", algorithm, "--preset", "debug", "--out", str(out)]
    assert main([*arguments, "--steps", "128"]) == 0
    assert all((out / name).exists() for name in FILES)
    metrics = json.loads((out / "metrics.json").read_text())
    assert metrics["train_steps"] >= 128
    assert OnnxPolicy(out / "model.onnx").contract.task == "lane"


def test_navigation_sees_picture_and_path(tmp_path: Path) -> None:
    out = tmp_path / "run"
    arguments = ["train", "--task", "navigation", "--preset", "debug", "--algo", "dueling"]
    asked = ["--map", "arena", "hamlet", "--pose-error", "arena", "--steps", "128"]
    assert main([*arguments, *asked, "--out", str(out)]) == 0
    assert OnnxPolicy(out / "model.onnx").contract.path_points == 10
    assert RunFolder(out).load_config().pose_error == "arena"


def test_racing_sees_four_pictures_and_has_nine_actions(tmp_path: Path) -> None:
    out, model = tmp_path / "run", tmp_path / "run" / "model.onnx"
    arguments = ["train", "--task", "track", "--preset", "debug", "--algo", "a3c"]
    asked = ["--map", "karting", "--look", "tracks/dusk", "--steps", "64"]
    assert main([*arguments, *asked, "--out", str(out)]) == 0
    with pytest.raises(ContractError, match="another robot"):
        OnnxPolicy(model)
    contract = open_policy(model).contract
    assert (contract.frames, contract.actions) == (4, RACING_ACTIONS)
    evaluated = ["evaluate", "--model", str(model), "--map", "karting", "--episodes", "2"]
    assert main([*evaluated, "--json", str(tmp_path / "e.json")]) == 0
    figures = json.loads((tmp_path / "e.json").read_text())
    assert -0.01 <= figures["laps"] <= 1.1  # it may stand
    assert figures["collisions"] <= 2
    assert main([*evaluated, "--task", "lane"]) == 2


def test_a_wrong_pose_error_names_the_nearest(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["train", "--task", "navigation", "--preset", "debug", "--pose-error", "area"]
    assert main([*arguments, "--out", str(tmp_path / "run")]) == 2
    assert "'arena'" in capsys.readouterr().err
    assert not (tmp_path / "run").exists()


def test_export_command_adds_int8(tmp_path: Path) -> None:
    out = tmp_path / "run"
    assert main(["train", "--preset", "debug", "--out", str(out), "--steps", "128"]) == 0
    assert main(["export", str(out)]) == 0
    assert OnnxPolicy(RunFolder(out).onnx_int8).contract.run == "run"


def test_a_wrong_map_leaves_nothing_behind(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "run"
    assert main(["train", "--preset", "debug", "--map", "town", "--out", str(out)]) == 2
    assert "ring of road" in capsys.readouterr().err
    assert not out.exists()
