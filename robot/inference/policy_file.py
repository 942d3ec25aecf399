"""A policy file before it drives: its contract, its inputs and outputs."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Union

import numpy as np

from robot.contract import ACTION_WHEELS, CONTROL_DT_S, PATH_POINTS, ActionTable, PolicyContract
from robot.errors import ContractError, DuckpilotError
from robot.inference.network_file import Tensor, open_network, read_metadata

SPEED_TOLERANCE_MPS = 1e-6  # between the action table of a model and ours
SHIPPED_MODELS = Path(__file__).parent.parent / "models"
REMEDY = "export the policy with python -m trainer export"


def read_contract(path: Union[str, Path], actions: ActionTable = ACTION_WHEELS) -> PolicyContract:
    """The contract inside a policy file, checked against ours, without loading its network.

    Args:
        path: of the file.
        actions: the table that the policy must have been trained for.

    Raises:
        ContractError: see ``OnnxPolicy``.
    """
    text = read_metadata(path, PolicyContract.METADATA_KEY, REMEDY)
    try:
        contract = PolicyContract.from_json(text)
    except DuckpilotError as error:
        raise ContractError(f"{path}: {error}") from error
    _check_drive(path, contract, actions)
    return contract


def _check_drive(path: Union[str, Path], contract: PolicyContract, expected: ActionTable) -> None:
    actions = np.array(contract.actions, dtype=float)
    ours = np.array(expected, dtype=float)
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
    inputs = [Tensor("image", "tensor(uint8)", (None, *contract.picture_shape))]
    if contract.path_points:
        inputs.append(Tensor("path", "tensor(float)", (None, contract.path_points)))
    outputs = [Tensor("values", "tensor(float)", (None, len(contract.actions)))]
    return open_network(path, inputs, outputs, threads, REMEDY)
