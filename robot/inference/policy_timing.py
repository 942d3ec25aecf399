"""How long one decision takes: from a frame to the values of the actions."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Union

import numpy as np

from robot.inference.policy import OnnxPolicy
from robot.inference.preprocess import FRAME_SHAPE, preprocess
from robot.parts import Policy

DECISIONS = 300
WARM_UP = 20


@dataclass(frozen=True)
class PolicyTiming:
    """Half of the decisions took at most ``p50_ms``, 99 of 100 at most ``p99_ms`` [ms]."""

    p50_ms: float
    p99_ms: float


def time_policy(
    model: Union[str, Path], threads: int = 1, decisions: int = DECISIONS
) -> PolicyTiming:
    """Time preprocessing and inference of a policy file, one frame at a time.

    Raises:
        ContractError: the file keeps no contract.
    """
    return time_decisions(OnnxPolicy(model, threads), decisions)


def time_decisions(policy: Policy, decisions: int = DECISIONS) -> PolicyTiming:
    """Time preprocessing and inference of an open policy, one frame at a time."""
    rng = np.random.default_rng(0)
    frame = rng.integers(0, 256, FRAME_SHAPE, dtype=np.uint8)
    path = np.zeros((1, policy.contract.path_points), np.float32)
    times_ms = []
    for _ in range(WARM_UP + decisions):
        began_s = time.perf_counter()
        picture = preprocess(frame, policy.contract.image)
        policy.values(picture[None], path if path.size else None)
        times_ms.append(1e3 * (time.perf_counter() - began_s))
    p50_ms, p99_ms = np.percentile(times_ms[WARM_UP:], (50, 99))
    return PolicyTiming(float(p50_ms), float(p99_ms))
