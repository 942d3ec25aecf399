"""A policy file before it drives: its contract, its inputs and outputs."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Optional, Union

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
from robot.inference.network_file import Tensor, open_network, read_metadata

TOLERANCE = 1e-6  # of an action's two numbers
SHIPPED_MODELS = Path(__file__).parent.parent / "models"
REMEDY = "export the policy with python -m trainer export"


def read_contract(path: Union[str, Path], actions: Optional[ActionTable] = None) -> PolicyContract:
    """The contract inside a policy file, checked against ours, without loading its network.

    Args:
        path: of the file.
        actions: of another vehicle, whose table the policy must have; without, this robot's wheels
            must be able to do each.

    Raises:
        ContractError: see ``OnnxPolicy``.
    """
    text = read_metadata(path, PolicyContract.METADATA_KEY, REMEDY)
    try:
        contract = PolicyContract.from_json(text)
    except DuckpilotError as error:
        raise ContractError(f"{path}: {error}") from error
    _check_actions(path, contract.actions, actions)
    _check_drive(path, contract)
    return contract


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


def _check_drive(path: Union[str, Path], contract: PolicyContract) -> None:
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
    inputs = [Tensor("image", "tensor(uint8)", (None, *contract.picture_shape))]
    if contract.path_points:
        inputs.append(Tensor("path", "tensor(float)", (None, contract.path_points)))
    outputs = [Tensor("values", "tensor(float)", (None, len(contract.actions)))]
    return open_network(path, inputs, outputs, threads, REMEDY)
