"""From a picture to an action: a trained network on one CPU thread, and how it decides.

Runtime and replay decide with the same two pure functions.

A translator stands between the preprocessed picture and the policy. In training it makes simulated
pictures look real (Bousmalis et al. 2018 call it pixel-level adaptation); on the robot another one
makes real pictures look simulated. Whatever makes the file, CycleGAN or pix2pix, keeps its
contract.
"""

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Callable, Dict, Literal, Optional, Sequence, Tuple, Union

import numpy as np

from robot.contract import (
    COMMANDS,
    CONTROL_DT_S,
    MAX_WHEEL_MPS,
    MOST_ACTIONS,
    PATH_POINTS,
    ActionTable,
    ImageSpec,
    InFile,
    PolicyContract,
)
from robot.errors import ContractError
from robot.inference.network_file import BYTES, FLOATS, Network, Tensor
from robot.inference.preprocess import FRAME_SHAPE, preprocess
from robot.parts import Policy

TOLERANCE = 1e-6  # of an action's two numbers
SHIPPED_MODELS = Path(__file__).parent.parent / "models"
REMEDY = "export the policy with duckpilot export"


class OnnxPolicy(Network[PolicyContract]):
    """A policy from an ONNX file.

    Another vehicle's have other ``actions``: its table, which the policy must have. Without, this
    robot's wheels must be able to do each.
    ContractError: as of `Network`, or its actions, inputs, outputs or values are not those of the
    contract.
    """

    def __init__(self, path: Union[str, Path], actions: Optional[ActionTable] = None) -> None:
        super().__init__(path, PolicyContract, REMEDY)
        contract = self.contract
        _check_actions(path, contract.actions, actions)
        for what, got, valid in (
            ("seconds between decisions", contract.control_dt_s, (CONTROL_DT_S,)),
            ("path points", contract.path_points, (0, PATH_POINTS)),
            ("commands", contract.commands, (0, COMMANDS)),
        ):
            if got not in valid:
                told = f"expected {' or '.join(map(str, valid))} {what}, got {got}"
                raise ContractError(f"{path}: {told}; train it again with this version")
        follows = [Tensor("path", FLOATS, (None, contract.told))]
        values = Tensor("values", FLOATS, (None, len(contract.actions)))
        self.expect(contract.picture_shape, values, *(follows if contract.told else ()))
        ramp = np.linspace(0, 255, num=int(np.prod(contract.picture_shape)))
        image = ramp.astype(np.uint8).reshape(contract.picture_shape)
        for count in (2, 1):  # slow first calls and broken exports show here
            paths = np.zeros((count, contract.told), np.float32)
            self.values(np.stack([image] * count), paths if paths.size else None)

    def values(self, images: np.ndarray, path: Optional[np.ndarray] = None) -> np.ndarray:
        """What each action is worth: (N, actions) float32; the best is the greatest.

        ``images`` are (N, H, W, 3 frames) uint8 RGB, each of ``preprocess``, ``path`` (N,
        told) float32 in [-1, 1] for a policy that is told anything, else None. ContractError: a
        wrong shape or kind, or the network answered NaN or infinity.
        """
        values = self.answer(images, **self._checked_path(len(images), path))
        expected = (len(images), len(self.contract.actions))
        if values.shape != expected:
            told = f"expected values {expected}, got {values.shape}"
            raise ContractError(f"{self.path}: {told}; export it again")
        if not np.isfinite(values).all():
            told = f"{self.path}: expected finite values, got {values.tolist()}; "
            raise ContractError(f"{told}the network is broken: take an earlier checkpoint")
        return values

    def _checked_path(self, count: int, path: Optional[np.ndarray]) -> Dict[str, np.ndarray]:
        points = self.contract.told
        if points == 0 and path is None:
            return {}
        if path is not None and points:
            path = np.ascontiguousarray(path, dtype=np.float32)
            if path.shape == (count, points) and (np.abs(path) <= 1.0).all():  # no NaN either
                return {"path": path}
        expected = f"({count}, {points}) float32 in [-1, 1]" if points else "no path"
        got = "none" if path is None else f"{np.shape(path)} {np.asarray(path).tolist()}"
        told = f"{self.path.name} is a {self.contract.task} policy"
        raise ContractError(f"path: expected {expected}, got {got}; {told}")


def read_contract(path: Union[str, Path]) -> PolicyContract:
    """The contract inside a policy file, of any vehicle; ContractError where there is none."""
    return Network(path, PolicyContract, REMEDY).contract


def _check_actions(
    path: Union[str, Path], actions: ActionTable, vehicle: Optional[ActionTable]
) -> None:
    table = np.array(actions, dtype=float)
    if vehicle is not None:
        same = table.shape == np.shape(vehicle) and np.allclose(table, vehicle, 0.0, TOLERANCE)
        expected = f"actions {np.array(vehicle).tolist()}"
    else:  # a NaN fails the comparison too
        slow = bool((np.abs(table) <= MAX_WHEEL_MPS + TOLERANCE).all())
        same = slow and 2 <= len(actions) <= MOST_ACTIONS
        expected = f"2 to {MOST_ACTIONS} actions, wheel speeds up to {MAX_WHEEL_MPS:.3f} m/s"
    if not same:
        told = "this policy was trained for another robot: train it again"
        raise ContractError(f"{path}: expected {expected}, got {table.tolist()}; {told}")


AT_REST = (0.0,) * (2 * COMMANDS)


def values_of(
    policy: Policy,
    image: Optional[np.ndarray],
    path: Optional[np.ndarray],
    commands: Sequence[float] = AT_REST,
) -> Optional[np.ndarray]:
    """What the policy thinks of each action (actions,), perhaps not finite.

    None without a frame ``image`` (120, 160, 3) uint8, or without the ``path`` (path_points,) of a
    mission where the policy follows one. ``commands`` are the last ones, the oldest first, as
    `robot.contract.shares`. ContractError: the policy answered in another shape.
    """
    contract = policy.contract
    if image is None or (contract.path_points and path is None):
        return None
    way = path if path is not None and contract.path_points else ()
    told = np.array([[*way, *commands[: 2 * contract.commands]]], np.float32)
    paths = told if contract.told else None
    values = np.asarray(policy.values(preprocess(image, contract.image)[None], paths))
    expected = (1, len(contract.actions))
    if values.shape != expected:
        raise ContractError(f"policy: expected values {expected}, got {values.shape}")
    return values[0]


def best_action(values: Optional[np.ndarray]) -> Optional[int]:
    """Which action has the greatest value; None without values, or where one is not finite."""
    if values is None or not np.isfinite(values).all():
        return None
    return int(values.argmax())


DECISIONS, WARM_UP = 300, 20


@dataclass(frozen=True)
class PolicyTiming:
    """Half of the decisions took at most ``p50_ms``, 99 of 100 at most ``p99_ms`` [ms]."""

    p50_ms: float
    p99_ms: float


def time_decisions(policy: Policy, decisions: int = DECISIONS) -> PolicyTiming:
    """Time a policy from the frame to the values of its actions, one frame at a time."""
    frame = np.random.default_rng(0).integers(0, 256, FRAME_SHAPE, dtype=np.uint8)
    path = np.zeros(policy.contract.path_points, np.float32)
    times_ms = []
    for _ in range(WARM_UP + decisions):
        began_s = time.perf_counter()
        values_of(policy, frame, path)
        times_ms.append(1e3 * (time.perf_counter() - began_s))
    p50_ms, p99_ms = np.percentile(times_ms[WARM_UP:], (50, 99))
    return PolicyTiming(float(p50_ms), float(p99_ms))


Direction = Literal["sim-to-real", "real-to-sim", "to-parsing"]
DIRECTIONS: Tuple[Direction, Direction] = ("sim-to-real", "real-to-sim")
PARSING: Direction = "to-parsing"  # of a parser: the classes it sees, in simulation as in reality
TRANSLATOR_REMEDY = "make the translator with duckpilot translate train"
Translator = Callable[[np.ndarray], np.ndarray]  # (N, H, W, 3) uint8 RGB, into a fresh array


@dataclass(frozen=True)
class TranslatorContract(InFile):
    """ONNX input: ``image`` uint8 (N, H, W, 3) RGB. Output: ``translation``, the same."""

    method: str  # cyclegan, pix2pix, segnet
    direction: Direction
    image: ImageSpec
    run: str = ""  # name of the training run
    trained_steps: int = 0
    schema: int = 1
    notes: Tuple[str, ...] = ()

    METADATA_KEY = "duckpilot-translator"


class OnnxTranslator(Network[TranslatorContract]):
    """A translator from an ONNX file; ContractError as of `Network`, or it takes other pictures."""

    def __init__(self, path: Union[str, Path]) -> None:
        super().__init__(path, TranslatorContract, TRANSLATOR_REMEDY)
        shape = self.contract.image.shape
        self.expect(shape, Tensor("translation", BYTES, (None, *shape)))

    def __call__(self, pictures: np.ndarray) -> np.ndarray:
        """(N, H, W, 3) uint8 RGB -> the same, in a fresh array; ContractError: other pictures."""
        return self.answer(pictures) if len(pictures) else pictures.copy()


def open_translator(
    path: Union[str, Path], image: ImageSpec, direction: Optional[str] = None
) -> OnnxTranslator:
    """A translator of these pictures, in ``direction`` if that matters; ContractError: another."""
    translator = OnnxTranslator(path)
    if translator.contract.image != image:
        raise ContractError(
            f"{path}: expected a translator of the policy's pictures, {image}, got one of "
            f"{translator.contract.image}; train one with the policy's preset"
        )
    if direction is not None and translator.contract.direction not in (direction, PARSING):
        told = f"{path}: expected a translator {direction}, got {translator.contract.direction}; "
        raise ContractError(f"{told}export the other direction")
    return translator


class TranslatingPolicy:
    """A policy that sees every picture through a translator; keeps `robot.parts.Policy`."""

    def __init__(self, policy: Policy, translator: Translator) -> None:
        self._policy, self._translator = policy, translator
        self.contract = policy.contract

    def values(self, images: np.ndarray, path: Optional[np.ndarray] = None) -> np.ndarray:
        """(N, actions) for images (N, H, W, 3 F), F stacked frames as they are untranslated."""
        count, height, width, channels = images.shape
        stacked = images.reshape(count, height, width, channels // 3, 3)
        frames = np.moveaxis(stacked, 3, 1)
        translated = self._translator(frames.reshape(-1, height, width, 3)).reshape(frames.shape)
        return self._policy.values(np.moveaxis(translated, 1, 3).reshape(images.shape), path)


def open_policy(path: Union[str, Path], translator: Union[str, Path, None] = None) -> Policy:
    """A policy, behind a translator from reality if there is one; ContractError as of either."""
    policy = OnnxPolicy(path)
    if not translator:
        return policy
    found = open_translator(translator, policy.contract.image, "real-to-sim")
    return TranslatingPolicy(policy, found)
