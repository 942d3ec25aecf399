"""A task in one short file does all that the project's own tasks do."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from robot.inference.policy import read_contract

ROOT = Path(__file__).parents[2]
SCRIPT = ROOT / "examples" / "own_task.py"


# Several commands of the script in one process: each would load all libraries anew.
ONE_BY_ONE = """
import json, sys; sys.path.insert(0, "examples")
import own_task
print([own_task.main(words) for words in json.loads(sys.argv[1])])
"""


def own_task(*commands: list[str], status: int = 0) -> subprocess.CompletedProcess[str]:
    done = subprocess.run(
        [sys.executable, "-c", ONE_BY_ONE, json.dumps(commands)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.endswith(f"{[status] * len(commands)}\n"), done.stderr
    return done


def test_a_task_is_one_file_of_at_most_80_lines() -> None:
    assert len(SCRIPT.read_text().splitlines()) <= 80
    packages = ("sim_pybullet", "trainer", "robot", "tools")
    files = [file for package in packages for file in (ROOT / package).rglob("*.py")]
    assert not [file for file in files if "keep_right" in file.read_text(encoding="utf-8")]


@pytest.mark.slow
def test_trains_evaluates_exports_and_reports(tmp_path: Path) -> None:
    run = tmp_path / "run"
    words = ["train", "--task", "keep_right", "--algo", "ppo", "--preset", "debug"]
    figures, report = run / "evaluation.json", tmp_path / "report"
    judging = ["evaluate", "--model", str(run / "model.onnx"), "--episodes", "2", "--workers", "1"]
    own_task(
        [*words, "--out", str(run)],
        [*judging, "--json", str(figures), "--drives"],
        ["export", str(run)],
        ["report", str(run), "--out", str(report)],
    )
    judged = json.loads(figures.read_text())
    assert judged["inputs"]["task"] == "keep_right"
    assert judged["inputs"]["maps"] == ["loop"]
    assert len(list(run.glob("evaluation_worst_*.mp4"))) >= len(judged["failures"])
    assert read_contract(run / "model_int8.onnx").task == "keep_right"
    page = (report / "report.html").read_text()
    assert "Keep right" in page
    assert page.count("<h3>Episode ") >= len(judged["failures"])


def test_its_reward_is_best_beside_the_middle_and_gymnasium_knows_it() -> None:
    program = """
import sys; sys.path.insert(0, "examples")
import gymnasium, numpy as np, own_task
env = gymnasium.make("duckpilot/KeepRight-v0", pool_size=1)
env.reset(seed=1)
*_, info = env.step(2)
task = env.unwrapped.world.task
offset = task.course.offset_m[0]
expected = -5.0 * abs(offset + 0.03) / task.half_lane_m[0]
assert abs(info["terms"]["offset"] - expected) < 1e-9, (info, expected)
assert abs(info["terms"]["offset"] + 5.0 * abs(offset) / task.half_lane_m[0]) > 0.001
"""
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr


def test_an_unknown_name_is_told_the_nearest(tmp_path: Path) -> None:
    train = ["train", "--out", str(tmp_path / "run")]
    done = own_task(
        [*train, "--task", "keep_rihgt"], [*train, "--task", "lane", "--algo", "dualing"], status=2
    )
    task, algorithm = done.stderr.splitlines()
    assert "did you mean 'keep_right'?" in task
    assert "did you mean 'dueling'?" in algorithm
