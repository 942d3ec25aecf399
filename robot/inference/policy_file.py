"""A policy file before it drives: its contract, its inputs and outputs."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Optional, Tuple, Union

import numpy as np

from robot.contract import (
    CONTROL_DT_S,
    MAX_WHEEL_MPS,
    MOST_ACTIONS,
    PATH_POINTS,
    ActionTable,
    PolicyContract,
)
from robot.errors import ContractError, DuckpilotError
from robot.inference.network_file import Tensor, expect_tensors, open_network, read_metadata

TOLERANCE = 1e-6  # of an action's two numbers
SHIPPED_MODELS = Path(__file__).parent.parent / "models"
REMEDY = "export the policy with python -m trainer export"


def read_contract(path: Union[str, Path]) -> PolicyContract:
    """The contract inside a policy file, of any vehicle; ContractError where there is none."""
    return _stated(path, open_network(path, REMEDY))


def _stated(path: Union[str, Path], network: Any) -> PolicyContract:
    text = read_metadata(path, network, PolicyContract.METADATA_KEY, REMEDY)
    try:
        return PolicyContract.from_json(text)
    except DuckpilotError as error:
        raise ContractError(f"{path}: {error}") from error


def open_policy_file(
    path: Union[str, Path], actions: Optional[ActionTable] = None
) -> Tuple[PolicyContract, Any]:
    """The contract inside a policy file, and the onnxruntime session that keeps it.

    Args:
        path: of the file.
        actions: of another vehicle, whose table the policy must have; without, this robot's wheels
            must be able to do each.

    ContractError: see `robot.inference.policy.OnnxPolicy`.
    """
    network = open_network(path, REMEDY)
    contract = _stated(path, network)
    _check_actions(path, contract.actions, actions)
    for what, got, valid in (
        ("seconds between decisions", contract.control_dt_s, (CONTROL_DT_S,)),
        ("path points", contract.path_points, (0, PATH_POINTS)),
    ):
        if got not in valid:
            expected = " or ".join(map(str, valid))
            raise ContractError(
                f"{path}: expected {expected} {what}, got {got}; train it again with this version"
            )
    inputs = [Tensor("image", "tensor(uint8)", (None, *contract.picture_shape))]
    if contract.path_points:
        inputs.append(Tensor("path", "tensor(float)", (None, contract.path_points)))
    outputs = [Tensor("values", "tensor(float)", (None, len(contract.actions)))]
    expect_tensors(path, network, inputs, outputs, REMEDY)
    return contract, network


def _check_actions(
    path: Union[str, Path], actions: ActionTable, vehicle: Optional[ActionTable]
) -> None:
    table = np.array(actions, dtype=float)
    if vehicle is not None:
        same = table.shape == np.shape(vehicle) and np.allclose(table, vehicle, 0.0, TOLERANCE)
        expected = f"actions {np.array(vehicle).tolist()}"
    else:  # a NaN fails the comparison too
        same = bool((np.abs(table) <= MAX_WHEEL_MPS + TOLERANCE).all())
        same = same and 2 <= len(actions) <= MOST_ACTIONS
        expected = f"2 to {MOST_ACTIONS} actions, wheel speeds up to {MAX_WHEEL_MPS:.3f} m/s"
    if not same:
        raise ContractError(
            f"{path}: expected {expected}, got {table.tolist()}; "
            "this policy was trained for another robot: train it again"
        )
