"""What a person did in a recording, as pictures with an action for each."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from robot.contract import DRIVE, PolicyContract
from robot.inference.policy import OnnxPolicy
from robot.inference.preprocess import preprocess
from robot.recording.topics import Turn
from trainer.twin.recorded import Recorded
from trainer.twin.ways import ways_driven

HELD_OUT = 0.3  # of each drive, its last part
MOVES_MPS = 0.05
CLEAR_PM = 2.5  # curvature from which on somebody steers, not only drives on
TAKEOVER_S, TAKEOVER_WEIGHT = 3.0, 4.0  # after a person took the wheel from the policy


class Examples(NamedTuple):
    """Pictures, what the policy was told of the way, and what the person did."""

    images: np.ndarray  # (N, H, W, 3)
    paths: np.ndarray | None  # (N, P)
    actions: np.ndarray  # (N,) the policy's action that is most like it
    weights: np.ndarray  # (N,)
    bends_pm: np.ndarray  # (N,) curvature that the person steered


def examples_of(drives: Sequence[Recorded], contract: PolicyContract, held_out: bool) -> Examples:
    """The moments that a person drove and the policy could have, of one part of each drive."""
    rows = []
    for drive in drives:
        last_s = (1.0 - HELD_OUT) * drive.times_s[-1]
        ways = ways_driven(drive) if contract.path_points else [()] * len(drive.turns)
        for k, taken_s in enumerate(_since_takeover(drive.turns)):
            way, bend_pm = ways[k], _bend(drive.turns[k].wheels)
            if way is None or taken_s is None or held_out != (drive.times_s[k] > last_s):
                continue
            if bend_pm is not None:
                weight = TAKEOVER_WEIGHT if taken_s < TAKEOVER_S else 1.0
                rows.append((drive.images[k], way, bend_pm, weight))
    images = [preprocess(row[0], contract.image) for row in rows]
    shape = (len(rows), *contract.image.shape)
    bends_pm = np.array([row[2] for row in rows])
    ours = np.array([_bend(wheels) or 0.0 for wheels in contract.actions])
    return Examples(
        np.array(images, np.uint8).reshape(shape),
        np.array([row[1] for row in rows], np.float32) if contract.path_points else None,
        np.abs(bends_pm[:, None] - ours).argmin(axis=1) if rows else np.zeros(0, int),
        np.array([row[3] for row in rows]),
        bends_pm,
    )


def foretold(actions: np.ndarray, seen: Examples, contract: PolicyContract) -> tuple[int, int]:
    """Of the moments when the person clearly steered, how many a policy steers to the same side.

    Returns:
        Their number, and that of all.
    """
    ours = np.array([_bend(wheels) or 0.0 for wheels in contract.actions])
    clear = np.abs(seen.bends_pm) > CLEAR_PM
    same = np.sign(ours[actions[clear]]) == np.sign(seen.bends_pm[clear])
    return int(same.sum()), int(clear.sum())


def told(policy: OnnxPolicy, seen: Examples) -> tuple[int, int]:
    """See `foretold`; of one moment at least."""
    return foretold(policy.act(seen.images, seen.paths), seen, policy.contract)


def _bend(wheels: Sequence[float]) -> float | None:
    """Curvature [1/m] of rim speeds; None where they stand."""
    forward_mps = 0.5 * (wheels[0] + wheels[1])
    if forward_mps < MOVES_MPS:
        return None
    return float((wheels[1] - wheels[0]) / DRIVE.baseline_m / forward_mps)


def _since_takeover(turns: Sequence[Turn]) -> list[float | None]:
    """For how long a person has driven [s], since they took over from the policy; None: nobody."""
    found: list[float | None] = []
    began_s, before = -np.inf, ""
    for turn in turns:
        if turn.state == "MANUAL" and before == "AUTO":
            began_s = turn.time_s
        found.append(turn.time_s - began_s if turn.state == "MANUAL" else None)
        before = turn.state
    return found
