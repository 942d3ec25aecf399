"""A trained policy, of whichever task, asked which way it would steer on frames of a real drive."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from robot.errors import ConfigError, ContractError
from robot.inference.policy import REMEDY, OnnxPolicy, open_translator, read_contract
from robot.inference.preprocess import preprocess_batch
from sim_pybullet.tasks.spec import find_task
from sim_pybullet.tasks.track_racing import RACING_ACTIONS
from trainer.experiments.records import FULL_LOCK_DEG, STACK, Turn, turns

_AT_ONCE = 256
_OF_WORTH = ("ddqn", "dueling")  # algorithms whose values are no logits


class SteeringPolicy:
    """Stacks of pictures -> turns, with an ONNX policy, seen through a translator if one is named.

    An actor with all-or-nothing wheels steers by how often it turns them: its steering is the mean
    of its actions' by their probabilities. What learned the worth of actions does the best one. A
    policy of one picture is shown the newest; a path it may have leads straight on.

    ContractError for no policy, or one that cannot go left, straight and right; or a translator of
    other pictures.
    """

    def __init__(self, path: Path, translator: str = "") -> None:
        contract = read_contract(path)
        self._policy = OnnxPolicy(path, actions=contract.actions)
        self.image, self.frames = contract.image, contract.frames
        self.translator = translator
        self._translator = (
            open_translator(translator, self.image, "real-to-sim") if translator else None
        )
        actions = np.array(contract.actions)
        drives_a_car = find_task(contract.task).actions == RACING_ACTIONS
        # people's angles are positive to the right, steering of race cars to the left; a robot
        # goes right where its left wheel is the faster
        right = -actions[:, 0] if drives_a_car else actions[:, 0] - actions[:, 1]
        self._steering_deg = FULL_LOCK_DEG * right / np.abs(right).max(initial=1e-9)
        if set(turns(self._steering_deg).tolist()) != set(Turn):
            raise ContractError(
                f"{path}: expected a policy that can go left, straight and right, got actions "
                f"{actions.tolist()}; {REMEDY}"
            )
        if not 1 <= self.frames <= STACK:
            raise ContractError(
                f"{path}: expected at most {STACK} stacked pictures, got {self.frames}"
            )
        self._worth = contract.algorithm in _OF_WORTH

    def see(self, frames: np.ndarray) -> np.ndarray:
        """Frames (N, 120, 160, 3) of reality -> the policy's pictures (N, H, W, 3), uint8."""
        pictures = preprocess_batch(frames, self.image)
        return pictures if self._translator is None else self._translator(pictures)

    def turns(self, stacks: np.ndarray) -> np.ndarray:
        """(N, H, W, 3 * STACK) uint8 -> (N,) int64 values of `Turn`."""
        newest, points = stacks[..., -3 * self.frames :], self._policy.contract.path_points
        values = []
        for part in np.array_split(newest, -(-len(stacks) // _AT_ONCE)):
            path = np.zeros((len(part), points), np.float32) if points else None
            values.append(self._policy.values(np.ascontiguousarray(part), path))
        found = np.concatenate(values)
        if self._worth:
            return turns(self._steering_deg[found.argmax(1)])
        shares = np.exp(found - found.max(1, keepdims=True))
        return turns(shares @ self._steering_deg / shares.sum(1))


def named_policies(given: Sequence[str]) -> list[tuple[str, int, SteeringPolicy]]:
    """(name, seed, policy) of each ``name=model.onnx`` or ``name=model.onnx+translator.onnx``.

    A name again is another seed. ConfigError without a name, ContractError if it is no policy.
    """
    found: list[tuple[str, int, SteeringPolicy]] = []
    for text in given:
        name, _, path = text.partition("=")
        if not name or not path:
            raise ConfigError(
                f"--policy: expected name=model.onnx, got {text!r}; such as ours=model.onnx"
            )
        seed = sum(name == other for other, _, _ in found)
        model, _, translator = path.partition("+")
        found.append((name, seed, SteeringPolicy(Path(model), translator)))
    return found
