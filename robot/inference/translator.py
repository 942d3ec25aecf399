"""Pictures of one world as another shows them: simulation as reality, or the other way.

A translator stands between the preprocessed picture and the policy. In training it makes simulated
pictures look real (Bousmalis et al. 2018 call it pixel-level adaptation); on the robot another one
makes real pictures look simulated. Whatever makes the file, CycleGAN or pix2pix, keeps this
contract.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Callable, Optional, Tuple, Union

import numpy as np

from robot.contract import ImageSpec, InFile
from robot.errors import ContractError, nearest
from robot.inference.network_file import (
    Tensor,
    expect_pictures,
    expect_tensors,
    open_network,
    read_stated,
)
from robot.inference.policy import OnnxPolicy
from robot.parts import Policy

DIRECTIONS = ("sim-to-real", "real-to-sim")
PARSING = "to-parsing"  # of a parser, which shows the classes it sees, in simulation as in reality
REMEDY = "make the translator with python -m trainer translate train"


# (N, H, W, 3) uint8 RGB -> (N, H, W, 3) uint8 RGB, in a fresh array
Translator = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class TranslatorContract(InFile):
    """Of every translator.

    ONNX input: ``image`` uint8 (N, H, W, 3) RGB. Output: ``translation``, the same. ContractError:
    an unknown direction, with the nearest one.
    """

    method: str  # cyclegan, pix2pix, segnet
    direction: str  # one of DIRECTIONS, or PARSING
    image: ImageSpec
    run: str = ""  # name of the training run
    trained_steps: int = 0
    schema: int = 1
    notes: Tuple[str, ...] = ()

    METADATA_KEY = "duckpilot-translator"

    def __post_init__(self) -> None:
        known = (*DIRECTIONS, PARSING)
        if self.direction not in known:
            raise ContractError(
                f"direction: unknown {self.direction!r}; {nearest(self.direction, known)}"
            )


class OnnxTranslator:
    """A translator from an ONNX file, whose metadata holds a ``TranslatorContract``.

    ContractError: the file is absent or damaged, too new for the robot's onnxruntime, without
    metadata, or its input or output are not those of the contract.
    """

    def __init__(self, path: Union[str, Path]) -> None:
        self.path = Path(path)
        self._network = open_network(path, REMEDY)
        self.contract = read_stated(path, self._network, TranslatorContract, REMEDY)
        axes = (None, *self.contract.image.shape)
        inputs = [Tensor("image", "tensor(uint8)", axes)]
        outputs = [Tensor("translation", "tensor(uint8)", axes)]
        expect_tensors(path, self._network, inputs, outputs, REMEDY)

    @property
    def image(self) -> ImageSpec:
        """The pictures that it takes and gives."""
        return self.contract.image

    def __call__(self, pictures: np.ndarray) -> np.ndarray:
        """(N, H, W, 3) uint8 RGB -> (N, H, W, 3) uint8 RGB, in a fresh array.

        ContractError: pictures of another size or kind.
        """
        given = expect_pictures(pictures, self.contract.image.shape, self.path.name)
        if not len(pictures):
            return pictures.copy()
        return np.asarray(self._network.run(["translation"], {"image": given})[0])


def open_translator(
    path: Union[str, Path], image: ImageSpec, direction: Optional[str] = None
) -> OnnxTranslator:
    """A translator of the policy's pictures, in this direction where only one makes sense.

    ContractError: see ``OnnxTranslator``; or it is for other pictures or the other direction.
    """
    translator = OnnxTranslator(path)
    if translator.image != image:
        raise ContractError(
            f"{path}: expected a translator of the policy's pictures, {image}, got one of "
            f"{translator.image}; train one with the policy's preset"
        )
    if direction is not None and translator.contract.direction not in (direction, PARSING):
        raise ContractError(
            f"{path}: expected a translator {direction}, got {translator.contract.direction}; "
            "export the other direction"
        )
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

    def act(self, images: np.ndarray, path: Optional[np.ndarray] = None) -> np.ndarray:
        """The greedy actions (N,) int64; arguments as of ``values``."""
        return self.values(images, path).argmax(axis=1)


def open_policy(path: Union[str, Path], translator: Union[str, Path, None] = None) -> Policy:
    """A policy, behind a translator from reality if there is one; ContractError as of either."""
    policy = OnnxPolicy(path)
    if not translator:
        return policy
    found = open_translator(translator, policy.contract.image, "real-to-sim")
    return TranslatingPolicy(policy, found)
