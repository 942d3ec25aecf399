"""A policy file before it drives: its versions, its contract, its inputs and outputs."""

from __future__ import annotations

from pathlib import Path
from typing import Any, List, NamedTuple, Sequence, Tuple, Union

import numpy as np

from robot.contract import ACTION_WHEELS, CONTROL_DT_S, PATH_POINTS, PolicyContract
from robot.errors import ContractError, DuckpilotError
from robot.onnx_header import read_header

# onnxruntime 1.19.2, the newest for a Jetson Nano, loads no later file (measured).
MAX_IR_VERSION = 10
MAX_OPSET = 21
SPEED_TOLERANCE_MPS = 1e-6  # between the action table of a model and ours


class Tensor(NamedTuple):
    """An input or output of a network: onnxruntime's word for its kind, and its axes."""

    name: str
    kind: str
    axes: Tuple[Union[int, str, None], ...]  # a name or None is an axis of any size

    def __str__(self) -> str:
        axes = ", ".join("N" if axis is None else str(axis) for axis in self.axes)
        return f"{self.name} {self.kind} ({axes})"

    def fits(self, got: Tensor) -> bool:
        """Whether ``got`` is this tensor, with a free batch axis; other free axes may be ours."""
        return (
            got.kind == self.kind
            and len(got.axes) == len(self.axes)
            and not isinstance(got.axes[0], int)
            and all(g == a for g, a in zip(got.axes[1:], self.axes[1:]) if isinstance(g, int))
        )


def read_contract(path: Union[str, Path]) -> PolicyContract:
    """The contract inside a policy file, checked against ours, without loading its network.

    Raises:
        ContractError: see ``OnnxPolicy``.
    """
    header = read_header(path)
    _check_version(path, "IR version", header.ir_version, MAX_IR_VERSION)
    _check_version(path, "opset", header.opset, MAX_OPSET)
    text = header.metadata.get(PolicyContract.METADATA_KEY)
    if text is None:
        raise ContractError(
            f"{path}: expected metadata under {PolicyContract.METADATA_KEY!r}, got keys "
            f"{sorted(header.metadata)}; export the policy with python -m trainer export"
        )
    try:
        contract = PolicyContract.from_json(text)
    except DuckpilotError as error:
        raise ContractError(f"{path}: {error}") from error
    _check_drive(path, contract)
    return contract


def _check_version(path: Union[str, Path], name: str, got: int, most: int) -> None:
    if not 1 <= got <= most:
        raise ContractError(
            f"{path}: expected {name} 1 to {most}, got {got}; the robot's onnxruntime loads no "
            "other: export the policy with python -m trainer export"
        )


def _check_drive(path: Union[str, Path], contract: PolicyContract) -> None:
    actions = np.array(contract.actions, dtype=float)
    ours = np.array(ACTION_WHEELS, dtype=float)
    if actions.shape != ours.shape or not np.allclose(actions, ours, 0.0, SPEED_TOLERANCE_MPS):
        raise ContractError(
            f"{path}: expected actions {ours.tolist()} [m/s left, right], "
            f"got {actions.tolist()}; this policy was trained for another robot: train it again"
        )
    if contract.control_dt_s != CONTROL_DT_S:
        raise ContractError(
            f"{path}: expected a decision every {CONTROL_DT_S} s, got {contract.control_dt_s} s; "
            "train it again with this version"
        )
    if contract.path_points not in (0, PATH_POINTS):
        raise ContractError(
            f"{path}: expected 0 or {PATH_POINTS} path points, got {contract.path_points}; "
            "train it again with this version"
        )


def open_session(path: Path, contract: PolicyContract, threads: int) -> Any:
    """An onnxruntime session whose inputs and outputs are those of the contract.

    Raises:
        ContractError: see ``OnnxPolicy``.
    """
    import onnxruntime as ort
    from onnxruntime.capi import onnxruntime_pybind11_state as state

    options = ort.SessionOptions()
    options.intra_op_num_threads = threads
    options.inter_op_num_threads = 1
    options.log_severity_level = 3  # its errors come as exceptions; its warnings are not for users
    # onnxruntime's exceptions share no base class of its own.
    damaged = (state.Fail, state.InvalidGraph, state.InvalidProtobuf, state.InvalidArgument)
    unsupported = (state.NotImplemented, state.RuntimeException, state.NoSuchFile)
    try:
        session = ort.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
    except (*damaged, *unsupported) as error:
        raise ContractError(
            f"{path}: expected a model that onnxruntime {ort.__version__} loads, got: "
            f"{str(error).strip()}; export it again"
        ) from error
    inputs = [Tensor("image", "tensor(uint8)", (None, *contract.image.shape))]
    if contract.path_points:
        inputs.append(Tensor("path", "tensor(float)", (None, contract.path_points)))
    outputs = [Tensor("values", "tensor(float)", (None, len(contract.actions)))]
    _check_tensors(path, "inputs", inputs, session.get_inputs())
    _check_tensors(path, "outputs", outputs, session.get_outputs())
    return session


def _check_tensors(path: Path, role: str, expected: List[Tensor], nodes: Sequence[Any]) -> None:
    got = {node.name: Tensor(node.name, node.type, tuple(node.shape)) for node in nodes}
    same = set(got) == {tensor.name for tensor in expected}
    if not (same and all(tensor.fits(got[tensor.name]) for tensor in expected)):
        raise ContractError(
            f"{path}: expected {role} {'; '.join(map(str, expected))}, "
            f"got {'; '.join(map(str, got.values())) or 'none'}; "
            "export the policy with python -m trainer export"
        )
