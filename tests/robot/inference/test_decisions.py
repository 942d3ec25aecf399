"""How a network is opened, compared, asked and timed."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, List, Optional, Tuple

import numpy as np
import pytest

from robot.contract import ImageSpec
from robot.errors import ContractError
from robot.inference import policy as module
from robot.inference.network_file import Network, Tensor, open_network
from robot.inference.policy import (
    OnnxPolicy,
    TranslatingPolicy,
    best_action,
    read_contract,
    time_decisions,
    values_of,
)
from tests.robot.tiny_onnx import lane_contract, navigation_contract, write_policy

SMALL = ImageSpec(16, 12, 4)
FRAME = np.random.default_rng(0).integers(0, 256, (120, 160, 3), dtype=np.uint8)
FLOAT = "tensor(float)"
OURS = Tensor("image", FLOAT, (None, 8, 16, 3))


@pytest.mark.parametrize(
    ("axes", "fits"),
    [
        ((None, 8, 16, 3), True),
        (("n", 8, 16, 3), True),
        ((None, "h", None, 3), True),
        ((1, 8, 16, 3), False),
        ((None, 8, 17, 3), False),
        ((None, 8, 16, 4), False),
        ((None, 8, 16), False),
        ((None, 8, 16, 3, 1), False),
    ],
)
def test_axes_fit_where_they_are_equal_or_free(axes: Tuple[Any, ...], fits: bool) -> None:
    assert OURS.fits(Tensor("image", FLOAT, axes)) is fits
    assert not OURS.fits(Tensor("image", "tensor(uint8)", axes))


class Opened(Network):
    """A network with these tensors, without a file."""

    def __init__(self, inputs: List[Tensor], outputs: List[Tensor]) -> None:
        def nodes(tensors: List[Tensor]) -> List[Any]:
            return [SimpleNamespace(name=t.name, type=t.kind, shape=list(t.axes)) for t in tensors]

        self.path, self._remedy = Path("a"), "mend it"
        self._session = SimpleNamespace(
            get_inputs=lambda: nodes(inputs), get_outputs=lambda: nodes(outputs)
        )


def test_a_network_has_the_tensors_of_its_contract_and_no_others() -> None:
    path, values = Tensor("path", FLOAT, (None, 10)), Tensor("values", FLOAT, (None, 5))
    image = Tensor("image", "tensor(uint8)", (None, *SMALL.shape))
    Opened([path, image], [values]).expect(SMALL.shape, values, path)
    for inputs, outputs, role in (
        ([image], [values], "inputs"),
        ([OURS, path], [values], "inputs"),
        ([image, path, values], [values], "inputs"),
        ([image, path], [], "outputs"),
        ([image, path], [values, path], "outputs"),
        ([image, path._replace(name="way")], [values], "inputs"),
    ):
        with pytest.raises(ContractError, match=f"a: expected {role} .*; mend it"):
            Opened(inputs, outputs).expect(SMALL.shape, values, path)
    with pytest.raises(ContractError, match=r"image tensor\(uint8\) \(N, 8, 16, 3\); path .*none"):
        Opened([], []).expect(SMALL.shape, values, path)


def test_a_network_keeps_to_one_thread(tmp_path: Path) -> None:
    path = write_policy(tmp_path / "m.onnx", lane_contract(image=SMALL))
    options = open_network(path, "").get_session_options()
    assert (options.intra_op_num_threads, options.inter_op_num_threads) == (1, 1)
    assert options.log_severity_level == 4, "its errors come as exceptions"
    assert OnnxPolicy(path)._session.get_session_options().intra_op_num_threads == 1


class Thinker:
    """A policy that says what it was asked."""

    def __init__(self, points: int = 0, answer: Optional[np.ndarray] = None) -> None:
        self.contract = navigation_contract() if points else lane_contract()
        self.contract = replace(self.contract, image=SMALL)
        self.asked: List[Tuple[np.ndarray, Optional[np.ndarray]]] = []
        self._answer = np.arange(5.0)[None] if answer is None else answer

    def values(self, images: np.ndarray, path: Optional[np.ndarray] = None) -> np.ndarray:
        self.asked.append((images, path))
        return self._answer


def test_a_frame_is_asked_about_as_the_policy_sees_it() -> None:
    policy, path = Thinker(), np.zeros(10, np.float32)
    assert values_of(policy, None, None) is None
    found = values_of(policy, FRAME, path)
    assert found is not None
    assert found.tolist() == [0.0, 1.0, 2.0, 3.0, 4.0]
    ((images, told),) = policy.asked
    assert images.shape == (1, *SMALL.shape)
    assert told is None, "it follows no path"


def test_a_navigator_is_not_asked_without_a_path() -> None:
    policy, path = Thinker(10), np.linspace(-1.0, 1.0, 10).astype(np.float32)
    assert values_of(policy, FRAME, None) is None
    assert values_of(policy, None, path) is None
    assert policy.asked == []
    values_of(policy, FRAME, path)
    ((_, told),) = policy.asked
    assert told is not None
    np.testing.assert_array_equal(told, path[None])


@pytest.mark.parametrize("shape", [(1, 4), (5,), (2, 5), (1, 5, 1)])
def test_an_answer_of_another_shape_is_refused(shape: Tuple[int, ...]) -> None:
    with pytest.raises(ContractError, match=r"expected values \(1, 5\), got"):
        values_of(Thinker(answer=np.zeros(shape)), FRAME, None)


def test_the_best_action_is_that_of_the_greatest_finite_value() -> None:
    assert best_action(np.array([0.0, 3.0, 1.0])) == 1
    assert best_action(np.array([2.0, 2.0, 1.0])) == 0
    assert best_action(None) is None
    for broken in (math.nan, math.inf, -math.inf):
        assert best_action(np.array([0.0, broken, 1.0])) is None


def test_decisions_are_timed_after_twenty_that_do_not_count(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The first twenty take a second each, the next hundred 1 to 100 ms."""
    policy, now_s, calls = Thinker(10), [0.0], [0]

    def perf_counter() -> float:
        calls[0] += 1
        if calls[0] % 2 == 0:
            number = calls[0] // 2
            now_s[0] += 1.0 if number <= 20 else 1e-3 * (number - 20)
        return now_s[0]

    monkeypatch.setattr(module.time, "perf_counter", perf_counter)
    timing = time_decisions(policy, 100)
    assert len(policy.asked) == 120
    assert timing.p50_ms == pytest.approx(50.5)
    assert timing.p99_ms == pytest.approx(99.01)
    assert all(path is not None and path.shape == (1, 10) for _, path in policy.asked)
    policy.asked.clear()
    time_decisions(policy)
    assert len(policy.asked) == 320


def test_a_policy_is_tried_when_it_is_opened(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: List[Tuple[np.ndarray, Optional[np.ndarray]]] = []
    monkeypatch.setattr(OnnxPolicy, "values", lambda _, i, p=None: seen.append((i, p)))
    for contract, points in (
        (lane_contract(image=SMALL), 0),
        (navigation_contract(image=SMALL), 10),
    ):
        seen.clear()
        OnnxPolicy(write_policy(tmp_path / "m.onnx", contract))
        assert [len(images) for images, _ in seen] == [2, 1]
        for images, path in seen:
            assert (images.min(), images.max()) == (0, 255)
            assert images.shape[1:] == SMALL.shape
            assert (path is None) if not points else (path is not None and not path.any())


@pytest.mark.parametrize(
    ("speed", "opens"), [(0.3461, True), (-0.3461, True), (0.3463, False), (-0.3463, False)]
)
def test_no_action_is_faster_than_a_wheel(tmp_path: Path, speed: float, opens: bool) -> None:
    """0.346 m/s: 0.3 m/s ahead, and the hard turns' 0.6 rad/s on half of the axle."""
    from robot.contract import MAX_WHEEL_MPS

    edge = MAX_WHEEL_MPS + (5e-7 if opens else 2e-6)
    actions = ((0.1, 0.1), (math.copysign(edge, speed), 0.1))
    path = write_policy(tmp_path / "m.onnx", lane_contract(image=SMALL, actions=actions))
    if opens:
        assert read_contract(path).actions == actions
        with pytest.raises(ContractError, match="expected outputs values"):
            OnnxPolicy(path)  # the network has five
    else:
        with pytest.raises(ContractError, match="trained for another robot"):
            OnnxPolicy(path)


@pytest.mark.parametrize(("off", "same"), [(5e-7, True), (2e-6, False)])
def test_the_table_of_another_vehicle_is_that_to_a_millionth(
    tmp_path: Path, off: float, same: bool
) -> None:
    contract = lane_contract(image=SMALL)
    path = write_policy(tmp_path / "m.onnx", contract)
    table = tuple((left, right + off) for left, right in contract.actions)
    if same:
        OnnxPolicy(path, actions=table)
    else:
        with pytest.raises(ContractError, match="expected actions"):
            OnnxPolicy(path, actions=table)
    with pytest.raises(ContractError, match="expected actions"):
        OnnxPolicy(path, actions=table[:-1])


def test_what_is_translated_is_decided_by_the_greatest_value() -> None:
    class Same:
        image = SMALL

        def __call__(self, pictures: np.ndarray) -> np.ndarray:
            return pictures

    answer = np.array([[0.0, 2.0, 1.0, 0.0, 0.0], [5.0, 2.0, 1.0, 0.0, 9.0]])
    policy = TranslatingPolicy(Thinker(answer=answer), Same())
    images, path = np.zeros((2, *SMALL.shape), np.uint8), np.zeros((2, 10), np.float32)
    assert policy.values(images, path).argmax(axis=1).tolist() == [1, 4]
    ((_, told),) = policy._policy.asked  # type: ignore[attr-defined]
    assert told is path
