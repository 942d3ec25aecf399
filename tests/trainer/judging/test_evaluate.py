import json
from pathlib import Path

import numpy as np
import pytest

from robot.contract import PolicyContract
from robot.inference.policy import OnnxPolicy
from robot.navigation.road_map import load_map
from sim_pybullet.look import NOMINAL
from trainer.cli import main
from trainer.export import export_network
from trainer.judging.evaluate import Drive, Inputs, evaluate, summarise, wilson_low
from trainer.learners.algorithms import build_policy
from trainer.learners.networks import GreedyNetwork
from trainer.presets import preset


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("model") / "untrained.onnx"
    config = preset("lane", "ddqn", "debug")
    contract = PolicyContract("lane", "ddqn", config.image)
    export_network(GreedyNetwork(build_policy(config)), contract, path)
    return path


@pytest.fixture(scope="module")
def navigator(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("model") / "untrained.onnx"
    config = preset("navigation", "ddqn", "debug")
    contract = PolicyContract("navigation", "ddqn", config.image, path_points=10)
    export_network(GreedyNetwork(build_policy(config)), contract, path)
    return path


def drive(model: Path, seeds: range) -> list[Drive]:
    return evaluate(OnnxPolicy(model), "lane", [load_map("loop")], [NOMINAL], seeds, lambda _: None)


def test_an_episode_is_the_same_alone_and_in_company(model: Path) -> None:
    together = drive(model, range(1018, 1023))
    assert [d.seed for d in together] == [1018, 1019, 1020, 1021, 1022]
    assert drive(model, range(1021, 1022)) == together[3:4]


def test_the_later_rounds_of_a_robot_are_the_same_alone(navigator: Path) -> None:
    def navigate(seeds: range) -> list[Drive]:
        arena = [load_map("arena")]
        return evaluate(
            OnnxPolicy(navigator), "navigation", arena, [NOMINAL], seeds, lambda _: None
        )

    together = navigate(range(103, 107))
    assert [d.seed for d in together] == [103, 104, 105, 106]
    assert navigate(range(104, 105)) == together[1:2]
    assert len({d.metrics for d in together}) == 4


def test_an_untrained_policy_fails_and_its_figures_add_up(model: Path) -> None:
    policy, drives = OnnxPolicy(model), drive(model, range(40, 60))
    inputs = Inputs(str(model), "lane", ("loop",), "nominal", None, None, 20, 40)
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


def test_a_zeroed_input_is_zero_and_the_other_is_not(navigator: Path) -> None:
    policy = OnnxPolicy(navigator)
    seen = []

    class Watched:
        contract = policy.contract

        def act(self, pictures: np.ndarray, path: np.ndarray) -> np.ndarray:
            seen.append((bool(pictures.any()), bool(path.any())))
            return policy.act(pictures, path)

    arena = [load_map("arena")]
    for zero in (None, "image", "path"):
        drives = evaluate(
            Watched(),  # type: ignore[arg-type]
            "navigation",
            arena,
            [NOMINAL],
            range(1),
            lambda _: None,
            zero,
        )
        assert [d.seed for d in drives] == [0]
        assert set(seen) == {(zero != "image", zero != "path")}
        seen.clear()


def test_navigation_is_evaluated_on_several_maps_with_pose_error(
    navigator: Path, tmp_path: Path
) -> None:
    out = tmp_path / "e.json"
    arguments = ["evaluate", "--model", str(navigator), "--map", "arena", "hamlet"]
    asked = ["--pose-error", "arena", "--zero", "image", "--episodes", "2", "--seed", "19"]
    assert main([*arguments, *asked, "--json", str(out)]) == 0
    inputs = json.loads(out.read_text())["inputs"]
    assert (inputs["task"], inputs["maps"]) == ("navigation", ["arena", "hamlet"])
    assert (inputs["pose_error"], inputs["zero"]) == ("arena", "image")


def test_lane_keeping_has_no_path_to_zero(model: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["evaluate", "--model", str(model), "--zero", "path"]) == 2
    assert "expected image, got path" in capsys.readouterr().err


def test_wilson_interval_of_the_literature() -> None:
    assert wilson_low(200, 200) == pytest.approx(0.981, abs=5e-4)
    assert wilson_low(50, 50) == pytest.approx(0.929, abs=5e-4)
    assert wilson_low(0, 10) == pytest.approx(0.0, abs=1e-12)


def test_a_look_without_all_that_varies_is_the_nominal_one(model: Path, tmp_path: Path) -> None:
    out = tmp_path / "e.json"
    groups = ["ground", "sky", "light", "clutter", "camera", "sensor", "drive", "timing"]
    arguments = ["evaluate", "--model", str(model), "--episodes", "3", "--json", str(out)]
    assert main([*arguments, "--look", "randomised", "--without", *groups]) == 0
    bare = json.loads(out.read_text())
    assert main([*arguments, "--look", "nominal"]) == 0
    nominal = json.loads(out.read_text())
    assert bare["inputs"]["without"] == groups
    assert {**bare, "inputs": None} == {**nominal, "inputs": None}
    assert main([*arguments, "--look", "randomised", "--without", "sensor.nois"]) == 2
