from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from robot.contract import PATH_POINTS, Action, ImageSpec, PolicyContract, shares
from robot.errors import ContractError
from robot.inference.policy import OnnxPolicy, read_contract, values_of
from tests.robot.tiny_onnx import (
    BIAS,
    COLOUR_WEIGHTS,
    FIXTURES,
    build_network,
    lane_contract,
    navigation_contract,
    write_network,
    write_policy,
)

SMALL = ImageSpec(16, 12, 4)
RED, GREEN, BLUE, BLACK = (255, 0, 0), (0, 255, 0), (0, 0, 255), (0, 0, 0)


def plain(*colours: tuple, spec: ImageSpec = SMALL) -> np.ndarray:
    return np.stack([np.full(spec.shape, colour, np.uint8) for colour in colours])


def test_reads_the_contract_and_decides(tmp_path: Path) -> None:
    contract = lane_contract(image=SMALL, run="run-1", trained_steps=7, score=0.5)
    policy = OnnxPolicy(write_policy(tmp_path / "m.onnx", contract))
    assert policy.contract == contract
    actions = policy.values(plain(RED, GREEN, BLUE, BLACK)).argmax(axis=1)
    assert actions.tolist() == [
        Action.LEFT,
        Action.SLIGHT_LEFT,
        Action.STRAIGHT,
        Action.STRAIGHT,
    ]


def test_a_path_steers_a_navigating_policy(tmp_path: Path) -> None:
    policy = OnnxPolicy(write_policy(tmp_path / "m.onnx", navigation_contract(image=SMALL)))
    ones = np.ones((1, PATH_POINTS), np.float32)
    images = plain(BLACK, BLACK, BLACK)
    actions = policy.values(images, np.concatenate((ones, 0 * ones, -ones))).argmax(axis=1)
    assert actions.tolist() == [Action.SLIGHT_LEFT, Action.STRAIGHT, Action.SLIGHT_RIGHT]


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(count=st.integers(1, 5), seed=st.integers(0, 99))
def test_values_are_the_networks_and_rows_do_not_mix(tmp_path: Path, count: int, seed: int) -> None:
    policy = OnnxPolicy(write_policy(tmp_path / "m.onnx", lane_contract(image=SMALL)))
    images = np.random.default_rng(seed).integers(0, 256, (count, *SMALL.shape), dtype=np.uint8)
    values = policy.values(images)
    assert values.dtype == np.float32
    expected = images.reshape(count, -1, 3).mean(1) / 255.0 @ COLOUR_WEIGHTS + BIAS
    np.testing.assert_allclose(values, expected, atol=1e-5)
    for image, row in zip(images, values):
        np.testing.assert_allclose(policy.values(image[None])[0], row, atol=1e-6)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(cut=st.integers(0, 400), junk=st.binary(max_size=40))
def test_a_damaged_file_is_refused_and_never_crashes(tmp_path: Path, cut: int, junk: bytes) -> None:
    good = write_policy(tmp_path / "good.onnx", lane_contract(image=SMALL)).read_bytes()
    (tmp_path / "bad.onnx").write_bytes(good[:cut] + junk)
    with pytest.raises(ContractError, match=r"bad\.onnx"):
        OnnxPolicy(tmp_path / "bad.onnx")


def refusal(path: Path) -> str:
    with pytest.raises(ContractError) as caught:
        OnnxPolicy(path)
    message = str(caught.value)
    assert "expected" in message
    assert "got" in message
    return message


def test_an_absent_file_is_refused(tmp_path: Path) -> None:
    assert "No such file" in refusal(tmp_path / "none.onnx")
    assert "directory" in refusal(tmp_path)


def test_a_file_too_new_for_onnxruntime_is_refused(tmp_path: Path) -> None:
    for versions in ({"ir_version": 99}, {"opset": 99}):
        path = write_policy(tmp_path / "m.onnx", lane_contract(), **versions)
        assert "export the policy with duckpilot export" in refusal(path)


def test_metadata_must_be_there_and_ours(tmp_path: Path) -> None:
    network = (FIXTURES / "lane.onnx").read_bytes()
    path = tmp_path / "m.onnx"
    assert "got keys ['other']" in refusal(write_network(path, network, {"other": "1"}))
    key = PolicyContract.METADATA_KEY
    assert "expected JSON" in refusal(write_network(path, network, {key: "{"}))
    for other in ("[]", lane_contract().to_json().replace('"schema": 1', '"schema": 2')):
        assert "expected schema 1" in refusal(write_network(path, network, {key: other}))
    typo = lane_contract().to_json().replace('"task"', '"taks"')
    with pytest.raises(ContractError, match="did you mean 'task'"):
        read_contract(write_network(path, network, {key: typo}))


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"actions": ((0.0, 1.0), (1.0, 1.0), (-1.0, 1.0))}, "trained for another robot"),
        ({"actions": ((0.1, 0.1), (0.346, 0.347), (0.2, 0.1))}, "trained for another robot"),
        ({"actions": ((0.1, 0.1), (0.1, float("nan")))}, "expected float, got nan"),
        ({"actions": ((0.1, 0.1),)}, "expected 2 to 16 actions"),
        ({"actions": ((0.1, 0.1),) * 17}, "expected 2 to 16 actions"),
        ({"control_dt_s": 0.05}, "expected 0.1 seconds between decisions, got 0.05"),
        ({"path_points": 3}, "expected 0 or 10 path points, got 3"),
    ],
)
def test_another_drive_is_refused(tmp_path: Path, changes: dict, said: str) -> None:
    assert said in refusal(write_policy(tmp_path / "m.onnx", lane_contract(**changes)))


@pytest.mark.parametrize(
    ("network", "said"),
    [
        ({"image_kind": "FLOAT"}, "got image tensor(float)"),
        ({"output": "q"}, "expected outputs values tensor(float) (N, 5), got q"),
        ({"actions": 4}, "got values tensor(float) (N, 4)"),
        ({"batch": 1}, "got image tensor(uint8) (1, H, W, 3)"),
        ({"path_points": 10}, "path tensor(float) (N, 10)"),
        ({"scale": float("nan")}, "expected finite values"),
        ({"scale": float("inf")}, "expected finite values"),
    ],
)
def test_another_signature_is_refused(tmp_path: Path, network: dict, said: str) -> None:
    metadata = {PolicyContract.METADATA_KEY: lane_contract(image=SMALL).to_json()}
    message = refusal(write_network(tmp_path / "m.onnx", build_network(**network), metadata))
    assert said in message


def test_a_navigation_contract_needs_a_path_input(tmp_path: Path) -> None:
    metadata = {PolicyContract.METADATA_KEY: navigation_contract().to_json()}
    network = (FIXTURES / "lane.onnx").read_bytes()
    assert "expected inputs image" in refusal(write_network(tmp_path / "m", network, metadata))


@pytest.mark.parametrize(
    "wrong",
    [
        plain(RED)[0],
        plain(RED, spec=ImageSpec(16, 12, 3)),
        plain(RED).astype(np.float32),
        plain(RED)[..., :2],
    ],
)
def test_a_wrong_picture_is_refused(tmp_path: Path, wrong: np.ndarray) -> None:
    policy = OnnxPolicy(write_policy(tmp_path / "m.onnx", lane_contract(image=SMALL)))
    with pytest.raises(ContractError, match=r"expected \(N, 8, 16, 3\) uint8, got"):
        policy.values(wrong)


def test_a_wrong_path_is_refused(tmp_path: Path) -> None:
    lane = OnnxPolicy(write_policy(tmp_path / "a.onnx", lane_contract(image=SMALL)))
    with pytest.raises(ContractError, match=r"expected no path, got \(1, 10\).*lane policy"):
        lane.values(plain(RED), np.zeros((1, 10), np.float32))
    drive = OnnxPolicy(write_policy(tmp_path / "b.onnx", navigation_contract(image=SMALL)))
    with pytest.raises(ContractError, match=r"got none; .*navigation policy"):
        drive.values(plain(RED))
    for wrong in (
        np.zeros((2, 10)),
        np.zeros((1, 9)),
        np.full((1, 10), np.nan),
        np.full((1, 10), 2),
    ):
        with pytest.raises(ContractError, match=r"expected \(1, 10\) float32 in \[-1, 1\]"):
            drive.values(plain(RED), wrong)


def test_a_lane_keeper_may_be_told_its_last_five_commands(tmp_path: Path) -> None:
    contract = lane_contract(image=SMALL, commands=5)
    told = {PolicyContract.METADATA_KEY: contract.to_json()}
    policy = OnnxPolicy(write_network(tmp_path / "m.onnx", build_network(10), told))
    commands = np.array([1.0, -1.0] * 5, np.float32)
    values = policy.values(plain(BLACK), commands[None])
    frame = np.zeros((120, 160, 3), np.uint8)
    np.testing.assert_array_equal(values_of(policy, frame, None, tuple(commands)), values[0])
    ignored = np.ones(10, np.float32)  # a path that it does not follow
    np.testing.assert_array_equal(values_of(policy, frame, ignored, tuple(commands)), values[0])
    at_rest = policy.values(plain(BLACK), np.zeros((1, 10)))[0]
    np.testing.assert_array_equal(values_of(policy, frame, None), at_rest)
    with pytest.raises(ContractError, match=r"expected \(1, 10\) float32 in \[-1, 1\], got none"):
        policy.values(plain(BLACK))
    told[PolicyContract.METADATA_KEY] = lane_contract(image=SMALL, commands=4).to_json()
    wrong = write_network(tmp_path / "w.onnx", build_network(8), told)
    assert "0 or 5 commands, got 4" in refusal(wrong)


def test_commands_are_told_as_shares_of_the_greatest_action_and_never_more() -> None:
    assert shares((0.3459, -0.17295)) == pytest.approx((1.0, -0.5), abs=1e-6)
    assert shares((9.0, -9.0)) == (1.0, -1.0)


def test_a_network_that_loads_but_fails_when_it_is_asked_is_refused(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    onnx = pytest.importorskip("onnx")
    model = onnx.load_from_string(build_network())
    model.graph.node[-1].output[0] = "sum"
    model.graph.initializer.append(onnx.numpy_helper.from_array(np.array([0, 1, 2, 3, 9]), "ix"))
    model.graph.node.append(onnx.helper.make_node("Gather", ["sum", "ix"], ["values"], axis=1))
    told = {PolicyContract.METADATA_KEY: lane_contract(image=SMALL).to_json()}
    path = write_network(tmp_path / "m.onnx", model.SerializeToString(), told)
    with pytest.raises(ContractError, match="expected an answer, got"):
        OnnxPolicy(path)
    assert capfd.readouterr().err == "", "onnxruntime itself says nothing beside"


@pytest.mark.parametrize("text", ["[" * 100_000, '{"schema": ' + "9" * 5000 + "}"])
def test_metadata_that_json_cannot_hold_is_refused(tmp_path: Path, text: str) -> None:
    network = (FIXTURES / "lane.onnx").read_bytes()
    path = write_network(tmp_path / "m.onnx", network, {PolicyContract.METADATA_KEY: text})
    with pytest.raises(ContractError, match="expected"):
        OnnxPolicy(path)


def test_a_name_that_no_file_can_have_is_refused() -> None:
    with pytest.raises(ContractError, match="expected an ONNX policy"):
        OnnxPolicy("a\0b.onnx")


@pytest.mark.parametrize("wrong", [float("inf"), -float("inf"), float("nan")])
def test_one_value_that_is_not_finite_is_refused(tmp_path: Path, wrong: float) -> None:
    policy = OnnxPolicy(write_policy(tmp_path / "m.onnx", lane_contract(image=SMALL)))
    values = np.array([[0.0, 1.0, wrong, 0.0, 0.0]], np.float32)
    policy.answer = lambda *_, **__: values  # type: ignore[method-assign]
    with pytest.raises(ContractError, match="expected finite values"):
        policy.values(plain(RED))
