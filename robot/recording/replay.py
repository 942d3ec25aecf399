"""Decides a recorded drive again, with the runtime's own functions, and compares.

On the processor and the versions that drove, every value must come out bit for bit. Elsewhere the
last bits of a network's sums differ (Higham, Accuracy and Stability of Numerical Algorithms,
section 4.2), so there only the choices must agree, as far as they were no toss-up.
"""

import tempfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import List, NamedTuple, Optional

import numpy as np

from robot.contract import MAX_WHEEL_MPS, PolicyContract, action_name
from robot.errors import ContractError
from robot.inference.policy import AT_REST, best_action, open_policy, values_of
from robot.parts import Policy
from robot.recording.drive_file import MODEL, TRANSLATOR, arithmetic
from robot.recording.reader import PathLike, read_about, read_attachment, read_turns
from robot.recording.topics import Turn

# Of the greatest value: a hundred times what float32 networks of ours differ by between processors.
TOLERANCE = 1e-3


class Difference(NamedTuple):
    """A turn that did not come out as it was."""

    number: int
    time_s: float
    sentence: str


@dataclass
class Replayed:
    """What a replay found."""

    exact: bool  # same processor and versions: values are compared bit for bit
    turns: int = 0
    decisions: int = 0
    close: int = 0  # decided otherwise where two actions were worth the same within rounding
    worst: float = 0.0  # greatest deviation of a value
    differences: List[Difference] = field(default_factory=list)


def replay(path: PathLike, policy: Optional[Policy] = None) -> Replayed:
    """Decide every turn of a recording again; errors as of ``read_turns``, ``recorded_policy``."""
    about = read_about(path)
    there, here = {name: about.get(name) for name in arithmetic()}, arithmetic()
    result = Replayed(exact=there == here and policy is None)
    policy = policy or recorded_policy(path)
    max_wheel_mps = float(about.get("max_wheel_mps", MAX_WHEEL_MPS))
    for turn, image in read_turns(path):
        result.turns += 1
        problems = _decision(result, policy, turn, image)
        problems += _wheels(turn, policy.contract, max_wheel_mps)
        result.differences += [Difference(turn.number, turn.time_s, text) for text in problems]
    return result


def recorded_policy(path: PathLike) -> Policy:
    """The policy that drove, behind its translator if any; ContractError: none, or too new."""
    with tempfile.TemporaryDirectory() as folder:
        model, translator = Path(folder) / MODEL, Path(folder) / TRANSLATOR
        for file in (model, translator):
            data = read_attachment(path, file.name)
            if data is not None:
                file.write_bytes(data)
        if not model.exists():
            told = "found none; is it a monitor's? Else name its file with --model"
            raise ContractError(f"{path}: expected the policy in the recording, {told}")
        return open_policy(model, translator if translator.exists() else None)


def _decision(made: Replayed, policy: Policy, turn: Turn, image: Optional[np.ndarray]) -> List[str]:
    if turn.values is None or turn.frame is None:
        return []
    if image is None:
        return ["its frame was not recorded"]
    path = None if turn.path is None else np.array(turn.path, np.float32)
    values = values_of(policy, image, path, turn.commands or AT_REST)
    if values is None:
        return ["decided without the path that its policy follows"]
    recorded, action = np.array(turn.values, np.float32), best_action(values)
    off, margin = float(np.abs(values - recorded).max()), turn.margin or 0.0
    made.decisions += 1
    made.worst = max(made.worst, off)
    allowed = 0.0 if made.exact else TOLERANCE * max(1.0, float(np.abs(recorded).max()))
    if off > allowed:
        return [f"values {list(turn.values)} came out as {values.tolist()}"]
    if action == turn.action:
        return []
    if margin <= 2.0 * allowed:
        made.close += 1
        return []
    names = [_name(policy.contract, number) for number in (turn.action, action)]
    return [f"{names[0]} came out as {names[1]}, by {margin:g}"]


def _wheels(turn: Turn, contract: PolicyContract, max_wheel_mps: float) -> List[str]:
    """Whether the wheels were told what the action and the limits make of it."""
    drive = turn.drive
    if drive is None:
        return []
    problems = []
    if turn.state == "AUTO" and turn.action is not None:
        name = _name(contract, turn.action)
        if contract.actions[turn.action : turn.action + 1] != (drive.wanted,):
            problems.append(f"wheels {tuple(drive.wanted)} are not those of {name}")
    limited = drive.limited(max_wheel_mps)
    if turn.state in ("AUTO", "MANUAL") and tuple(limited) != turn.wheels:
        problems.append(f"wheels {turn.wheels} came out as {tuple(limited)}")
    return problems


def _name(contract: PolicyContract, action: Optional[int]) -> str:
    if action is None:
        return "no action"
    known = 0 <= action < len(contract.actions)
    return action_name(contract.actions[action]) if known else "an action that it does not have"
