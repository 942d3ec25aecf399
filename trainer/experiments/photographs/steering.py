"""Whether a robot's policy would turn where a person turned, on frames of a recorded drive."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from robot.contract import Action
from robot.inference.policy import OnnxPolicy
from trainer.experiments.driving_pictures import Stacks, load_stacks, split_by_time
from trainer.experiments.records import Drive, Turn
from trainer.experiments.table1 import Accuracy, compare

# People's wheels count as turned from 10 degrees on, a bend of about a metre: ours are all tighter.
_TURNS = np.array(
    [
        {
            Action.LEFT: Turn.LEFT,
            Action.SLIGHT_LEFT: Turn.LEFT,
            Action.STRAIGHT: Turn.STRAIGHT,
            Action.SLIGHT_RIGHT: Turn.RIGHT,
            Action.RIGHT: Turn.RIGHT,
        }[action]
        for action in Action
    ]
)


def policy_turns(policy: OnnxPolicy, stacks: Stacks) -> np.ndarray:
    """(N,) values of `Turn` that a robot's policy chooses at some moments of a drive.

    A navigating policy is told that its path leads straight on: nobody planned one here.

    Args:
        policy: of one picture.
        stacks: the moments, in pictures as this policy sees them.
    """
    seen = stacks.pictures[stacks.last]
    points = policy.contract.path_points
    path = np.zeros((len(seen), points), np.float32) if points else None
    return np.asarray(_TURNS[policy.act(seen, path)])


def zero_shot(name: str, model: Path, drive: Drive) -> Accuracy:
    """How far a policy trained in simulation agrees with the person, on the test part of a drive.

    Raises:
        ContractError: not a policy for robots.
        ConfigError: the drive is too short.
    """
    policy = OnnxPolicy(model)
    test = split_by_time(load_stacks(drive, policy.contract.image))[1]
    return compare(name, 0, test.turns, policy_turns(policy, test))
