import json
from pathlib import Path

import numpy as np
import pytest

from robot.contract import PolicyContract
from robot.policy import OnnxPolicy
from robot.road_map import load_map
from sim_pybullet.look import NOMINAL
from trainer.algorithms import build_policy
from trainer.cli import main
from trainer.config import preset
from trainer.evaluate import Drive, Inputs, evaluate, summarise, wilson_low
from trainer.export import export_network
from trainer.networks import GreedyNetwork


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("model") / "untrained.onnx"
    config = preset("lane", "ddqn", "debug")
    contract = PolicyContract("lane", "ddqn", config.image)
    export_network(GreedyNetwork(build_policy(config)), contract, path)
    return path


def drive(model: Path, seeds: range) -> list[Drive]:
    return evaluate(OnnxPolicy(model), "lane", [load_map("loop")], [NOMINAL], seeds, lambda _: None)


def test_an_episode_is_the_same_alone_and_in_company(model: Path) -> None:
    together = drive(model, range(1018, 1023))
    assert [d.seed for d in together] == [1018, 1019, 1020, 1021, 1022]
    assert drive(model, range(1021, 1022)) == together[3:4]


def test_an_untrained_policy_fails_and_its_figures_add_up(model: Path) -> None:
    policy, drives = OnnxPolicy(model), drive(model, range(40, 60))
    inputs = Inputs(str(model), "lane", ("loop",), "nominal", 20, 40)
    result = summarise(inputs, policy, drives)
    assert result.episodes == 20
    assert result.success_rate == 1.0 - len(result.failures) / 20
    assert set(result.failures) <= set(range(40, 60))
    times = [d.metrics.survival_time_s for d in drives]
    assert result.survival_time_s == pytest.approx(np.mean(times))


def test_command_writes_the_agreed_keys(model: Path, tmp_path: Path) -> None:
    out = tmp_path / "e.json"
    arguments = ["evaluate", "--model", str(model), "--episodes", "3", "--seed", "7"]
    assert main([*arguments, "--json", str(out)]) == 0
    written = json.loads(out.read_text())
    for key in ("schema", "inputs", "episodes", "success_rate", "mean_path_distance_m"):
        assert key in written
    for key in ("survival_time_s", "driven_lane_m", "outside_lane_s", "failures"):
        assert key in written
    assert written["inputs"]["seed"] == 7
    assert written["episodes"] == 3


def test_wrong_inputs_are_status_2(model: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["evaluate", "--model", str(model), "--map", "lop"]) == 2
    assert "loop" in capsys.readouterr().err
    assert main(["evaluate", "--model", str(model), "--look", "nominl"]) == 2
    assert "nominal" in capsys.readouterr().err
    assert main(["evaluate", "--model", str(model.parent / "none.onnx")]) == 2
    assert main(["evaluate", "--model", str(model), "--episodes", "0"]) == 2


def test_wilson_interval_of_the_literature() -> None:
    assert wilson_low(200, 200) == pytest.approx(0.981, abs=5e-4)
    assert wilson_low(50, 50) == pytest.approx(0.929, abs=5e-4)
    assert wilson_low(0, 10) == pytest.approx(0.0, abs=1e-12)
