"""Whether a robot's policy would turn where a person turned, on frames of a recorded drive.

Twice: as it is, and looking from higher up (`higher_camera`), since people's tracks are wider than
ours. How much higher, and from which leaning on a turn counts as one, is then read off the first
part of the drive, the one that supervised networks learn from; figures are of the last part.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from robot.camera.source import fit_to_frame
from robot.contract import ACTION_WHEELS, FIVE_ACTIONS, Action
from robot.inference.policy import OnnxPolicy
from robot.inference.preprocess import preprocess_batch
from robot.lens import CameraRig
from trainer.experiments.driving_pictures import STACK, Stacks, split_by_time
from trainer.experiments.photographs.higher_camera import higher_view, lifted
from trainer.experiments.photographs.lane_pose import order
from trainer.experiments.records import Drive, Turn, turns
from trainer.experiments.table1 import Accuracy, compare
from trainer.parsing.labelled import read_rgb

TIMES_HIGHER = (1.0, 1.5, 2.0, 2.5, 3.0, 4.0)
_SHARPNESS = 3.0  # of the softmax over a policy's standardised values
_QUANTILES = 41  # of the leanings, that limits are chosen from

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
_RIGHTWARD = np.array([left - right for left, right in ACTION_WHEELS])


@dataclass(frozen=True)
class Steered:
    """One driver on the test part of a drive; NaN where there is no such thing."""

    result: Accuracy
    times_higher: float  # the camera
    order: float  # Spearman's correlation of the policy's leaning with the person's steering


class _Answer(NamedTuple):
    actions: np.ndarray  # (N,) values of `Action`
    leaning: np.ndarray  # (N,) expected difference of the wheels, positive to the right


def frames_of_drive(drive: Drive) -> np.ndarray:
    """(N, 120, 160, 3) uint8 RGB.

    Raises:
        ConfigError: a file is no picture.
    """
    return np.stack([fit_to_frame(read_rgb(file)) for file in drive.files])


def compare_steering(
    name: str, model: Path, frames: np.ndarray, steering_deg: np.ndarray, rig: CameraRig
) -> list[Steered]:
    """Zero-shot, and with a camera height and limits read off the first part of the drive.

    A navigating policy is told that its path leads straight on: nobody planned one here.

    Args:
        name: of the policy in the table.
        model: its ONNX file.
        frames: of `frames_of_drive`.
        steering_deg: (N,) what the person did, positive to the right.
        rig: the camera that is assumed.

    Raises:
        ContractError: not a policy for robots.
        ConfigError: the drive is too short.
    """
    policy = OnnxPolicy(model, actions=FIVE_ACTIONS)
    person = turns(steering_deg)
    first, last = _parts(person)
    answers = {times: _ask(policy, frames, higher_view(rig, times)) for times in TIMES_HIGHER}
    orders = {t: order(a.leaning[first], steering_deg[first]) for t, a in answers.items()}
    times = max(orders, key=lambda each: orders[each])
    leaning = answers[times].leaning
    guessed = _turns(leaning, *_limits(leaning[first], person[first]))
    found = []
    for title, height, chosen in (
        (name, 1.0, np.asarray(_TURNS[answers[1.0].actions])),
        (f"{name}, set by the first part", times, guessed),
    ):
        agreement = compare(title, 0, person[last], chosen[last])
        ranked = order(answers[height].leaning[last], steering_deg[last])
        found.append(Steered(agreement, height, ranked))
    return found


def leaning(values: np.ndarray) -> np.ndarray:
    """(N,) where values (N, actions) lean, positive to the right, as a share of the full turn."""
    standard = (values - values.max(1, keepdims=True)) / max(float(values.std()), 1e-9)
    shares = np.exp(_SHARPNESS * standard)
    return np.asarray(shares @ _RIGHTWARD / shares.sum(1) / _RIGHTWARD.max())


def _parts(person: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Indices of the frames that are learned from, and of those that are tested."""
    none = np.zeros((len(person), 1))
    later = np.arange(STACK - 1, len(person))
    first, last = split_by_time(Stacks(none, later, person[later]))
    return first.last, last.last


def _ask(policy: OnnxPolicy, frames: np.ndarray, view: np.ndarray) -> _Answer:
    from_higher = np.stack([lifted(frame, view) for frame in frames])
    seen = preprocess_batch(from_higher, policy.contract.image)
    points = policy.contract.path_points
    path = np.zeros((len(seen), points), np.float32) if points else None
    values = policy.values(seen, path)
    return _Answer(values.argmax(1), leaning(values))


def _limits(leanings: np.ndarray, person: np.ndarray) -> tuple[float, float]:
    """Between which leaning is straight on: those with the best mean of recalls."""
    candidates = np.quantile(leanings, np.linspace(0.0, 1.0, _QUANTILES))
    pairs = itertools.combinations(candidates.tolist(), 2)
    return max(pairs, key=lambda pair: _mean_recall(_turns(leanings, *pair), person))


def _turns(leanings: np.ndarray, left: float, right: float) -> np.ndarray:
    straight = np.where(leanings >= right, Turn.RIGHT, Turn.STRAIGHT)
    return np.where(leanings <= left, Turn.LEFT, straight)


def _mean_recall(guessed: np.ndarray, person: np.ndarray) -> float:
    asked: Sequence[Turn] = [turn for turn in Turn if (person == turn).any()]
    return float(np.mean([(guessed[person == turn] == turn).mean() for turn in asked]))
