import json
import shlex
from dataclasses import replace
from pathlib import Path

import pytest
import tyro

from tools.model_card import main, train_command
from trainer.options import TrainOptions
from trainer.presets import preset
from trainer.run import RunFolder


@pytest.fixture
def run(tmp_path: Path) -> Path:
    folder = RunFolder(tmp_path / "run")
    folder.go_on(preset("navigation", "ppo", "fast"))
    folder.metrics.write_text(
        json.dumps({"train_steps": 3000, "train_seconds": 31.0, "cpu_seconds": 20.0})
    )
    for name in ("model.onnx", "model_int8.onnx"):
        (folder.path / name).write_bytes(name.encode())
    return folder.path


def judge(run: Path, name: str, model: str, zero: str | None = None) -> None:
    inputs = {"model": model, "maps": ["a/town.yaml", "arena"], "look": "randomised"}
    inputs.update(pose_error="arena", zero=zero, seed=7)  # type: ignore[call-overload]
    shares = {"episodes": 1000, "success_rate": 0.997, "success_rate_low": 0.991}
    result = {"inputs": inputs, **shares, "survival_time_s": 9.0, "mean_path_distance_m": 0.0123}
    (run / name).write_text(json.dumps(result))


def test_policies_and_card_are_put_where_the_robot_finds_them(run: Path, tmp_path: Path) -> None:
    models = tmp_path / "models"
    models.mkdir()
    judge(run, "a.json", "runs/x/model.onnx")
    judge(run, "b.json", "runs/x/model_int8.onnx", "image")
    (run / "export.json").write_text(json.dumps({"frames": 1000, "int8_same_choice": 0.987}))
    assert main([str(run), "nav_new", "--models", str(models)]) == 0
    assert (models / "nav_new.onnx").read_bytes() == b"model.onnx"
    assert (models / "nav_new_int8.onnx").read_bytes() == b"model_int8.onnx"
    text = (models / "nav_new.md").read_text(encoding="utf-8")
    assert "| `nav_new.onnx` | town, arena | randomised, arena | 997 of 1000" in text
    assert "| `nav_new_int8.onnx`, picture empty" in text
    assert "3,000 steps" in text
    assert "alike on 98.7% of 1,000 frames that it was not calibrated on" in text


def test_the_card_names_the_map_with_the_fewest_successes(run: Path, tmp_path: Path) -> None:
    judge(run, "a.json", "model.onnx")
    result = json.loads((run / "a.json").read_text())
    rows = [("zed", "outer", 19), ("hat", "inner", 17), ("hat", "outer", 20)]
    result["by_map"] = [
        {"map": name, "lane": lane, "episodes": 20, "succeeded": good} for name, lane, good in rows
    ]
    (run / "a.json").write_text(json.dumps(result))
    assert main([str(run), "nav_new", "--models", str(tmp_path)]) == 0
    assert "| hat inner 17 of 20 |" in (tmp_path / "nav_new.md").read_text(encoding="utf-8")


def test_the_command_of_a_lane_keeper_says_where_it_drove_and_was_chosen() -> None:
    asked = TrainOptions("lane", "ppo", map=("loop", "rings/bean"), lane="both", judgings=5)
    asked = replace(asked, judge_map=("rings/fish",), start_spread=2.5, true_path=1.0, full=True)
    config = replace(asked, rate_left=0.05, look="randomised", steps=9_000).config()
    command = shlex.split(train_command(config, "runs/x"))
    again = tyro.cli(TrainOptions, args=command[4 : command.index("--out")])
    assert again.config() == config


@pytest.mark.parametrize("algorithm", ["ppo", "dueling"])
def test_the_command_on_the_card_asks_for_the_same_run(algorithm: str) -> None:
    asked = TrainOptions("navigation", algorithm, map=("hamlet", "yard"), steps=500, seed=3)
    config = asked.config()
    command = shlex.split(train_command(config, "runs/x"))
    again = tyro.cli(TrainOptions, args=command[4 : command.index("--out")])
    assert again.config() == config


def test_the_command_says_in_which_style_was_driven() -> None:
    config = TrainOptions("track", "ppo", map=("harbour",), style="cruise").config()
    command = shlex.split(train_command(config, "runs/x"))
    again = tyro.cli(TrainOptions, args=command[4 : command.index("--out")])
    assert again.config() == config


@pytest.mark.parametrize(("full", "rate_left"), [(False, None), (True, None), (True, 0.05)])
def test_the_command_says_what_differs_from_the_preset(full: bool, rate_left: float | None) -> None:
    config = TrainOptions("lane", "ppo", look="randomised", full=full, rate_left=rate_left).config()
    command = shlex.split(train_command(config, "runs/x"))
    again = tyro.cli(TrainOptions, args=command[4 : command.index("--out")])
    assert again.config() == config


def test_a_run_that_is_not_done_or_not_exported_is_status_2(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (run / "model_int8.onnx").unlink()
    assert main([str(run), "nav_new", "--models", str(tmp_path)]) == 2
    assert "trainer export" in capsys.readouterr().err
    assert main([str(tmp_path / "none"), "nav_new", "--models", str(tmp_path)]) == 2
    assert not (tmp_path / "nav_new.md").exists()
