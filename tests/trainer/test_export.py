import json
import shutil
from dataclasses import asdict
from pathlib import Path

import numpy as np
import onnx
import pytest
import torch

from robot.contract import PATH_POINTS, PolicyContract
from robot.errors import ConfigError, ContractError
from robot.inference.policy import OnnxPolicy
from tests.trainer.toy import build_model, make_toy, toy_config, train_toy
from trainer import export
from trainer.algorithms import NAMES
from trainer.config import RunConfig
from trainer.export import check_equal, export_network, export_run, quantise
from trainer.learners.networks import GreedyNetwork
from trainer.learners.policies import build_policy
from trainer.presets import preset
from trainer.run import RunFolder
from trainer.torch_file import save_torch
from trainer.training.checkpoint import Evaluated, TrainState, save_checkpoint


def network_and_contract(config: RunConfig) -> tuple[GreedyNetwork, PolicyContract]:
    torch.manual_seed(0)
    told = {"commands": config.commands, "score": 0.95}
    contract = PolicyContract("lane", config.algorithm, config.image, **told)
    return GreedyNetwork(build_policy(config)), contract


def observations(config: RunConfig, count: int) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(0)
    seen = {"image": rng.integers(0, 256, (count, *config.image.shape), dtype=np.uint8)}
    if config.commands:
        seen["path"] = rng.uniform(-1.0, 1.0, (count, 2 * config.commands)).astype(np.float32)
    return seen


@pytest.mark.parametrize("algorithm", NAMES)
def test_onnx_answers_as_torch_does(algorithm: str, tmp_path: Path) -> None:
    config = preset("lane", algorithm, "fast")
    network, contract = network_and_contract(config)
    path = tmp_path / "model.onnx"
    export_network(network, contract, path)
    assert check_equal(network, path, observations(config, 64)) <= 1e-4
    assert check_equal(network, path, observations(config, 1)) <= 1e-4
    policy = OnnxPolicy(path)
    assert policy.contract == contract
    seen = observations(config, 7)
    chosen = policy.values(seen["image"], seen.get("path")).argmax(axis=1)
    assert (chosen == network.actions(seen)).all()


def test_a_robot_can_load_it(tmp_path: Path) -> None:
    network, contract = network_and_contract(preset("lane", "dueling", "fast"))
    export_network(network, contract, tmp_path / "model.onnx")
    model = onnx.load(str(tmp_path / "model.onnx"))
    assert model.ir_version <= 9
    assert [(o.domain, o.version <= 17) for o in model.opset_import] == [("", True)]


def test_another_network_is_noticed(tmp_path: Path) -> None:
    config = preset("lane", "ddqn", "debug")
    network, contract = network_and_contract(config)
    export_network(network, contract, tmp_path / "model.onnx")
    other = GreedyNetwork(build_policy(config))
    with pytest.raises(ContractError, match="agree within"):
        check_equal(other, tmp_path / "model.onnx", observations(config, 8))


def test_one_answer_that_differs_by_a_ten_thousandth_is_told(tmp_path: Path) -> None:
    assert (export.TOLERANCE, export.GREY_TOLERANCE) == (1e-4, 1)
    ours, theirs = np.zeros((100, 5)), np.zeros((100, 5))
    for wrong in (0.5, -0.5):
        theirs[7, 3] = wrong
        assert export.expect_alike(tmp_path, ours, theirs, 0.5) == 0.5
        with pytest.raises(ContractError, match=r"they differ by 0\.5"):
            export.expect_alike(tmp_path, ours, theirs, 0.49)
    with pytest.raises(ContractError):
        export.expect_alike(tmp_path, ours, theirs * np.nan, 0.5)


def test_int8_loads_where_fp32_does_and_chooses_alike(tmp_path: Path) -> None:
    config = preset("lane", "dueling", "fast")
    network, contract = network_and_contract(config)
    export_network(network, contract, tmp_path / "model.onnx")
    batch = observations(config, 256)
    quantise(tmp_path / "model.onnx", batch, tmp_path / "int8.onnx")
    policy = OnnxPolicy(tmp_path / "int8.onnx")
    assert policy.contract == contract
    model = onnx.load(str(tmp_path / "int8.onnx"))
    assert model.ir_version <= 9
    assert all(o.version <= 17 for o in model.opset_import if not o.domain)
    values, exact = policy.values(batch["image"]), OnnxPolicy(tmp_path / "model.onnx")
    error = np.abs(values - exact.values(batch["image"]))
    assert error.mean() < 0.1 * exact.values(batch["image"]).std()


def test_both_inputs_are_exported(tmp_path: Path) -> None:
    from gymnasium import spaces

    from trainer.algorithms import find_algorithm
    from trainer.learners.policies import observation_space, policy_arguments

    config = preset("lane", "dueling", "debug")
    path_space = spaces.Box(-1.0, 1.0, (PATH_POINTS,), np.float32)
    both = spaces.Dict({"image": observation_space(config), "path": path_space})
    policy = find_algorithm(config.algorithm).policy(
        both, spaces.Discrete(5), lambda _: 1e-3, **policy_arguments(config)
    )
    network = GreedyNetwork(policy)
    contract = PolicyContract("navigation", "dueling", config.image, path_points=PATH_POINTS)
    export_network(network, contract, tmp_path / "model.onnx")
    path = np.random.default_rng(0).uniform(-1, 1, (9, PATH_POINTS)).astype(np.float32)
    batch = {**observations(config, 9), "path": path}
    assert check_equal(network, tmp_path / "model.onnx", batch) <= 1e-4
    assert OnnxPolicy(tmp_path / "model.onnx").values(batch["image"], path).shape == (9, 5)


def test_a_run_is_exported_and_checked_on_its_own_frames(tmp_path: Path) -> None:
    config = toy_config("dueling", 1_000)
    train_toy(config, tmp_path)
    folder = RunFolder(tmp_path)
    assert not folder.replay.exists()
    exported = export_run(folder, config, make_toy(config, 16, 5))
    assert exported.frames == 1_000
    assert exported.largest_difference <= 1e-4
    assert exported.int8_same_choice > 0.95
    assert json.loads(folder.exported.read_text()) == asdict(exported)
    contract = OnnxPolicy(folder.onnx_int8).contract
    assert (contract.run, contract.trained_steps, contract.score) == (tmp_path.name, 1_000, 1.0)


def test_the_policy_that_an_evaluation_kept_is_exported_and_not_the_last_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(export, "CHECKED_FRAMES", 16)
    monkeypatch.setattr(export, "quantise", lambda path, _, out: shutil.copy(path, out))
    config, folder = toy_config("dueling", 1_000), RunFolder(tmp_path)
    env, seen = make_toy(config, 8, 0), observations(config, 16)
    kept, last = (build_model(config, env, tmp_path / name) for name in ("kept", "last"))
    last.policy.q_net.q_net[1][-1].bias.data += torch.arange(5)  # else both are of one seed
    judged = tuple(
        Evaluated(step, 1.0, share, 9.0, 16.0, 1.0) for step, share in ((300, 0.75), (600, 0.5))
    )
    save_torch(folder.best, kept.policy.state_dict())
    save_checkpoint(folder.checkpoint, last, TrainState(evaluations=judged))
    export_run(folder, config, env)
    assert check_equal(GreedyNetwork(kept.policy), folder.onnx, seen) <= 1e-4
    contract = OnnxPolicy(folder.onnx).contract
    assert (contract.trained_steps, contract.score) == (300, 0.75)


def test_a_run_without_an_evaluation_has_nothing_to_export(tmp_path: Path) -> None:
    config = toy_config("dueling", 1_000)
    with pytest.raises(ConfigError, match="an evaluation kept"):
        export_run(RunFolder(tmp_path), config, make_toy(config, 4, 0))


def test_int8_is_checked_on_frames_that_did_not_calibrate_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An INT8 version that is right on its calibration only must not look good."""
    config = toy_config("dueling", 1_000)
    train_toy(config, tmp_path)
    folder, calibration = RunFolder(tmp_path), set()

    def learn_by_heart(_: Path, seen: dict[str, np.ndarray], out: Path) -> None:
        calibration.update(image.tobytes() for image in seen["image"])
        out.touch()

    def answer(path: Path, seen: dict[str, np.ndarray]) -> np.ndarray:
        known = [path == folder.onnx or i.tobytes() in calibration for i in seen["image"]]
        return np.eye(5)[np.where(known, 1, 4)]

    monkeypatch.setattr(export, "quantise", learn_by_heart)
    monkeypatch.setattr(export, "run_onnx", answer)
    monkeypatch.setattr(export, "check_equal", lambda *_: 0.0)
    monkeypatch.setattr(export, "CHECKED_FRAMES", 400)
    assert export_run(folder, config, make_toy(config, 16, 5)).int8_same_choice < 0.05
    assert len(calibration) == 400
