"""What a taught policy must show before a robot arms with it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from robot.contract import Proof
from robot.inference.policy import OnnxPolicy
from robot.navigation.road_map import RoadMap
from sim_pybullet.pool import Looks
from sim_pybullet.tasks.spec import find_task
from trainer.judging.evaluate import evaluate, wilson_low
from trainer.twin.examples import Examples, foretold

FIRST = 50_000  # number of the first drive


def prove(
    model: Path,
    road_map: RoadMap,
    twin: Looks,
    held_out: Examples,
    drives: int,
    finished: Callable[[Any], None],
) -> Proof:
    """Drive a policy in its twin, and ask it about recordings that it did not learn from."""
    policy = OnnxPolicy(model)
    contract = policy.contract
    rings = bool(find_task(contract.task).lanes)
    numbers = range(FIRST, FIRST + drives)
    lane = "both" if rings else None
    done = evaluate(policy, contract.task, [road_map], twin, numbers, finished, lane=lane)
    succeeded = sum(drive.success for drive in done)
    low, high = wilson_low(succeeded, drives), 1.0 - wilson_low(drives - succeeded, drives)
    same, steered = told(policy, held_out)
    what = "two-lap drives" if rings else "missions"
    share = 100.0 * succeeded / drives
    sentence = f"{share:.0f} % of {drives} {what} in its twin (95 %: {low:.0%} to {high:.0%})"
    if steered:
        sentence += f"; steers as the person did in {same} of {steered} held-out moments"
    return Proof(drives, succeeded, low, high, steered, same, sentence)


def told(policy: OnnxPolicy, seen: Examples) -> tuple[int, int]:
    """See `trainer.twin.examples.foretold`."""
    if not len(seen.actions):
        return 0, 0
    rows = range(len(seen.actions))
    paths = [None if seen.paths is None else seen.paths[k : k + 1] for k in rows]
    chosen = [policy.act(seen.images[k : k + 1], paths[k])[0] for k in rows]
    return foretold(np.array(chosen), seen, policy.contract)
