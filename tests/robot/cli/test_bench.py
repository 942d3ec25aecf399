from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from robot.cli import main
from robot.cli.bench import measure
from robot.cli.install import ROOT
from robot.errors import ContractError
from tests.robot.tiny_onnx import lane_contract, navigation_contract, write_policy


def test_the_report_has_its_keys(tmp_path: Path) -> None:
    model = write_policy(tmp_path / "m.onnx", navigation_contract())
    out = tmp_path / "bench.json"
    arguments = ["--model", str(model), "--json", str(out), "--seconds", "0.5"]
    assert main(["bench", *arguments]) == 0
    report = json.loads(out.read_text(encoding="utf-8"))
    assert report["schema"] == 1
    assert 0.0 < report["inference"]["p50_ms"] <= report["inference"]["p99_ms"]
    assert report["loop"]["turns"] == 5
    assert 0.0 <= report["loop"]["lag_p50_ms"] <= report["loop"]["lag_max_ms"]
    assert report["robot"]["import_s"] > 0.0


def test_wrong_input_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", "--model", str(tmp_path / "none.onnx")]) == 2
    with pytest.raises(SystemExit, match="2"):
        main(["bench", "--model", "m.onnx", "--seconds", "0"])
    assert "--seconds: expected a number from 0.5 to 3600, got '0'" in capsys.readouterr().err
    with pytest.raises(ContractError):
        measure(tmp_path / "none.onnx", 0.5)


def test_the_robot_stays_small(tmp_path: Path) -> None:
    """The budget of a Jetson Nano; `LEAN` holds what keeps its import short."""
    model = write_policy(tmp_path / "m.onnx", lane_contract())
    assert measure(model, 5.0)["robot"]["rss_mb"] < 150.0


LEAN = """
import pkgutil, importlib, sys
import robot
for module in pkgutil.walk_packages(robot.__path__, 'robot.'):
    if not module.name.endswith('__main__'):
        importlib.import_module(module.name)
heavy = {'cv2', 'onnxruntime', 'zmq', 'smbus2', 'torch', 'yaml', 'numba', 'gymnasium', 'onnx'}
print(sorted(heavy & set(sys.modules)))
"""


def test_importing_everything_loads_nothing_heavy_and_says_nothing() -> None:
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, "-c", LEAN], stdout=subprocess.PIPE, env=environment, check=True
    )
    assert done.stdout.decode().split("\n") == ["[]", ""]


def test_the_module_is_a_command() -> None:
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-m", "robot", "infer", "--model", "none", "--images", "none"]
    done = subprocess.run(
        [*command, "--json", "none"], stderr=subprocess.PIPE, env=environment, check=False
    )
    assert done.returncode == 2
    assert done.stderr.decode().count("\n") == 1
