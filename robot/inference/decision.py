"""From what the robot sees to what it chooses: pure, so that a recording replays it.

The runtime and `tools.replay` decide with these very functions.
"""

from __future__ import annotations

from typing import Optional

import numpy as np

from robot.errors import ContractError
from robot.inference.preprocess import preprocess
from robot.parts import Policy


def values_of(
    policy: Policy, image: Optional[np.ndarray], path: Optional[np.ndarray]
) -> Optional[np.ndarray]:
    """What the policy thinks of each action (actions,), perhaps not finite.

    None without a frame ``image`` (120, 160, 3) uint8, or without the ``path`` (path_points,) of a
    mission where the policy follows one.

    Raises:
        ContractError: the policy answered in another shape.
    """
    contract = policy.contract
    if image is None or (contract.path_points and path is None):
        return None
    paths = path[None] if path is not None and contract.path_points else None
    values = np.asarray(policy.values(preprocess(image, contract.image)[None], paths))
    if values.shape != (1, len(contract.actions)):
        raise ContractError(
            f"policy: expected values (1, {len(contract.actions)}), got {values.shape}"
        )
    return values[0]


def best_action(values: Optional[np.ndarray]) -> Optional[int]:
    """Which action has the greatest value; None without values, or where one is not finite."""
    if values is None or not np.isfinite(values).all():
        return None
    return int(values.argmax())
