"""A policy trained on race tracks, asked about frames of a real drive."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from robot.contract import ImageSpec, PolicyContract
from robot.errors import ConfigError, ContractError, nearest
from robot.inference.network_file import Tensor, open_network, read_metadata
from robot.typed_config import from_plain
from trainer.experiments.driving_pictures import STACK
from trainer.experiments.records import Turn

REMEDY = "export a policy of the task track with four stacked frames"
POLICIES = ("ours", "b-rl")
_AT_ONCE = 256


class RacingPolicy:
    """Stacks of pictures -> turns, with an ONNX policy of steering and pedals.

    The probabilities of the actions that steer alike are added up, whatever they do with the
    pedals, and the likeliest turn is chosen; the values are taken as logits.

    Raises:
        ContractError: not a policy for such stacks and actions.
    """

    def __init__(self, path: Path) -> None:
        plain = json.loads(read_metadata(path, PolicyContract.METADATA_KEY, REMEDY))
        self.image: ImageSpec = from_plain(ImageSpec, plain.get("image", {}), str(path))
        # the contract's steering is positive to the left, people's angles to the right
        steering = -np.array([action[0] for action in plain.get("actions", ())])
        self._turn_of = np.where(steering > 0, Turn.RIGHT, Turn.STRAIGHT)
        self._turn_of[steering < 0] = Turn.LEFT
        if plain.get("task") != "track" or set(self._turn_of) != set(Turn):
            raise ContractError(
                f"{path}: expected a policy of the task track that steers left, straight and "
                f"right, got task {plain.get('task')!r} with {len(steering)} actions; {REMEDY}"
            )
        shape = (None, *self.image.shape[:2], 3 * STACK)
        values = (None, len(steering))
        inputs = [Tensor("image", "tensor(uint8)", shape)]
        outputs = [Tensor("values", "tensor(float)", values)]
        self._session = open_network(path, inputs, outputs, 1, REMEDY)

    def turns(self, stacks: np.ndarray) -> np.ndarray:
        """(N, H, W, 3 * STACK) uint8 -> (N,) int64 values of `Turn`."""
        parts = np.array_split(stacks, -(-len(stacks) // _AT_ONCE))
        values = np.concatenate([self._session.run(["values"], {"image": p})[0] for p in parts])
        shares = np.exp(values - values.max(1, keepdims=True))
        of_turns = [shares[:, self._turn_of == turn].sum(1) for turn in Turn]
        return np.stack(of_turns, axis=1).argmax(1)


def named_policies(given: Sequence[str]) -> list[tuple[str, int, RacingPolicy]]:
    """(name, seed, policy) of each ``name=model.onnx``.

    Raises:
        ConfigError: no name, or one that the paper has not.
        ContractError: not a policy of the task track.
    """
    found: list[tuple[str, int, RacingPolicy]] = []
    for text in given:
        name, _, path = text.partition("=")
        if name not in POLICIES or not path:
            raise ConfigError(
                f"--policy: expected name=model.onnx, got {text!r}; {nearest(name, POLICIES)}"
            )
        seed = sum(name == other for other, _, _ in found)
        found.append((name, seed, RacingPolicy(Path(path))))
    return found
