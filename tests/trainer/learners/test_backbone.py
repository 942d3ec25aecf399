"""Policies that see by the layers of sight, and choose nearest to what the expert may do."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import onnx
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from onnxruntime import InferenceSession
from rich.console import Console

import robot
from robot.contract import FIVE_ACTIONS, PolicyContract
from robot.errors import ContractError
from robot.inference.policy import OnnxPolicy
from robot.vision.sight import OnnxSight
from tests.thorough import count
from trainer.envs import image_changed, make_env
from trainer.export import check_equal, export_network, noise_seen
from trainer.learners.backbone import Seer, read_backbone
from trainer.learners.networks import GreedyNetwork, Hedge
from trainer.learners.policies import build_policy
from trainer.options import TrainOptions
from trainer.presets import preset
from trainer.run import RunFolder
from trainer.training.train import train
from trainer.twin.teach import load_base

SIGHT = Path(robot.__file__).parent / "models" / "sight.onnx"


def pictures(count: int) -> np.ndarray:
    return np.random.default_rng(0).integers(0, 256, (count, 40, 80, 3), dtype=np.uint8)


def seeing(task: str) -> GreedyNetwork:
    config = preset(task, "dagger", "fast")
    network = GreedyNetwork(
        build_policy(replace(config, net=replace(config.net, backbone=str(SIGHT))))
    )
    for name, weight in network.named_parameters():
        if name.endswith("bias") and weight.requires_grad:  # equal ones are exported as one
            torch.nn.init.normal_(weight)
    return network


def test_it_sees_what_the_last_layer_of_sight_gets() -> None:
    model = onnx.load(str(SIGHT))
    head = next(node for node in reversed(model.graph.node) if node.op_type == "Gemm")
    model.graph.output.append(onnx.ValueInfoProto(name=head.input[0]))
    session = InferenceSession(model.SerializeToString(), providers=["CPUExecutionProvider"])
    images = pictures(4)
    expected = session.run([head.input[0]], {"image": images})[0]
    seen = read_backbone(SIGHT)(torch.from_numpy(images)).numpy()
    assert seen.shape == (4, 192)
    np.testing.assert_allclose(seen, expected, atol=1e-4)


def test_what_learners_are_shown_is_nearly_that() -> None:
    images = pictures(6)
    seer = Seer(SIGHT, "cpu")
    exact = read_backbone(SIGHT)(torch.from_numpy(images)).numpy()
    seen = seer(images)
    assert (seen.shape, seen.dtype, seer.width) == ((6, 192), np.float32, 192)
    assert np.abs(seen - exact).max() < 0.02 * exact.max()
    assert np.abs(seer(images[0]) - seen[0]).max() < 0.02 * exact.max()
    network = seeing("lane").features
    of_pictures, of_what_was_seen = network(torch.from_numpy(images)), network(torch.tensor(exact))
    assert torch.equal(of_pictures, of_what_was_seen)


@pytest.mark.parametrize(
    ("task", "algorithm"),
    [  # each task and each algorithm, those that keep pictures with and without a path
        ("navigation", "dueling"),
        ("navigation", "ppo"),
        ("lane", "dueling"),
        ("navigation", "dagger"),
        ("traffic", "dagger"),
    ][: count(2, 5)],
)
def test_runs_learn_from_what_it_saw_and_drive_by_pictures(
    task: str, algorithm: str, tmp_path: Path
) -> None:
    config = preset(task, algorithm, "debug")
    config = replace(
        config,
        steps=192,
        net=replace(config.net, backbone=str(SIGHT)),
        image=OnnxSight(SIGHT).contract.image,
        evaluation=replace(config.evaluation, episodes=1),
    )
    folder = RunFolder(tmp_path)
    train(config, folder, make_env, Console(quiet=True))
    policy = OnnxPolicy(folder.onnx)
    assert (policy.contract.algorithm, policy.contract.image) == (algorithm, config.image)
    layers = read_backbone(SIGHT).parameters(), read_backbone(folder.onnx).parameters()
    assert all(torch.equal(ours, theirs) for ours, theirs in zip(*layers, strict=True))


def test_what_learns_leaves_the_backbone_as_it_is() -> None:
    network = seeing("lane")
    before = [weight.clone() for weight in network.parameters()]
    learned = [weight.requires_grad for weight in network.parameters()]
    optimiser = torch.optim.Adam(network.parameters(), 1e-2)
    network(torch.from_numpy(pictures(8))).square().sum().backward()
    optimiser.step()
    changed = [not torch.equal(a, b) for a, b in zip(before, network.parameters(), strict=True)]
    assert changed == learned
    assert sum(learned) == 6  # three layers


@pytest.mark.parametrize("task", ["lane", "navigation"])
def test_the_exported_policy_has_it_inside_and_learns_on(task: str, tmp_path: Path) -> None:
    network, path = seeing(task), tmp_path / "policy.onnx"
    image = preset(task, "dagger", "fast").image
    points = 10 if task == "navigation" else 0
    contract = PolicyContract(task=task, algorithm="dagger", image=image, path_points=points)
    export_network(network, contract, path)
    check_equal(network, path, noise_seen(contract, 8))
    for ours, theirs in zip(
        read_backbone(SIGHT).parameters(), read_backbone(path).parameters(), strict=True
    ):
        assert torch.equal(ours, theirs)
    again, _ = load_base(path)
    for name, weight in again.named_parameters():
        assert weight.requires_grad == ("convolutions" not in name), "what it sees by stays"


def test_another_network_is_refused(tmp_path: Path) -> None:
    for other in ("lane_dueling.onnx", "sight_int8.onnx"):
        with pytest.raises(ContractError, match=rf"{other}.*take a sight in FP32"):
            read_backbone(SIGHT.with_name(other))
    (tmp_path / "no.onnx").write_bytes(b"no network")
    for absent in ("no.onnx", "none.onnx"):
        with pytest.raises(ContractError, match="take a sight in FP32"):
            read_backbone(tmp_path / absent)


def test_who_is_unsure_whether_left_or_right_goes_straight_on() -> None:
    torn = torch.log(torch.tensor([[0.51, 0.0, 0.0, 0.0, 0.49]]) + 1e-6)
    assert int(Hedge(FIVE_ACTIONS)(torn).argmax()) == 2


@given(st.integers(0, 4))
def test_who_is_sure_does_as_the_expert(action: int) -> None:
    logits = torch.full((1, 5), -20.0)
    logits[0, action] = 20.0
    assert int(Hedge(FIVE_ACTIONS)(logits).argmax()) == action


@given(st.lists(st.floats(-5.0, 5.0), min_size=5, max_size=5))
def test_the_choice_turns_as_near_as_can_be_to_the_mean(logits: list[float]) -> None:
    values = Hedge(FIVE_ACTIONS)(torch.tensor([logits]))[0]
    turns = np.array([right - left for left, right in FIVE_ACTIONS])
    chance = torch.tensor(logits, dtype=torch.float64).softmax(0).numpy()
    aside = np.abs(turns - chance @ turns)
    assert aside[int(values.argmax())] == pytest.approx(aside.min(), abs=1e-4)


def test_a_run_takes_the_pictures_of_its_backbone() -> None:
    config = TrainOptions(algo="dagger", preset="paper", backbone=str(SIGHT)).config()
    assert (config.net.backbone, config.image) == (str(SIGHT), OnnxSight(SIGHT).contract.image)


def test_of_stacked_pictures_it_sees_one_after_the_other() -> None:
    backbone, one, other = read_backbone(SIGHT), pictures(4)[:2], pictures(4)[2:]
    stacks = np.concatenate((one, other), axis=3)
    apart = [backbone(torch.from_numpy(images)) for images in (one, other)]
    torch.testing.assert_close(backbone(torch.from_numpy(stacks)), torch.cat(apart, 1))
    assert Seer(SIGHT, "cpu")(stacks).shape == (2, 2 * 192)


def test_seen_instead_leaves_the_path_as_it_is() -> None:
    seer, images, path = Seer(SIGHT, "cpu"), pictures(2), np.ones((2, 10), np.float32)
    both = image_changed({"image": images, "path": path}, seer)
    assert both["path"] is path
    assert np.array_equal(both["image"], image_changed(images, seer))
