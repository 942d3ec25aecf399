"""What a policy looks at: the feature visualisation of paper A (its Figures 27 to 29 and 40).

The channel mean of the last convolution is enlarged to the one before and multiplied with its
channel mean, layer by layer down to the first; the product, normalised, is laid over the picture.
Works on the ONNX file, so on every policy that can drive the robot.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

import cv2
import numpy as np
import onnx
from onnxruntime import InferenceSession, SessionOptions

from robot.camera.replay import open_reel
from robot.camera.source import fit_to_frame
from robot.contract import ImageSpec, PolicyContract
from robot.errors import ContractError
from robot.policy_file import read_contract
from robot.preprocess import preprocess

ATTENTION_SHARE = 0.55  # of the overlay's colour that comes from the colour map


class Explainer:
    """Attention maps of an ONNX policy.

    Raises:
        ContractError: the file is no policy of ours, or has no convolutions.
    """

    def __init__(self, path: Path) -> None:
        self.contract: PolicyContract = read_contract(path)
        model = onnx.load(path)
        self._layers = _convolution_outputs(model.graph)
        if not self._layers:
            raise ContractError(f"{path}: expected a network with convolutions, found none")
        for name in self._layers:
            model.graph.output.append(onnx.ValueInfoProto(name=name))
        options = SessionOptions()
        options.intra_op_num_threads = 1
        options.log_severity_level = 3
        self._session = InferenceSession(
            model.SerializeToString(), options, providers=["CPUExecutionProvider"]
        )

    def attention(self, images: np.ndarray) -> np.ndarray:
        """(N, H, W) float32 in [0, 1] for policy pictures (N, H, W, 3) uint8, each map's peak 1."""
        feeds = {"image": images}
        if self.contract.path_points:
            feeds["path"] = np.zeros((len(images), self.contract.path_points), np.float32)
        outputs = self._session.run(self._layers, feeds)
        means = [output.mean(axis=1) for output in outputs]  # (N, h, w) each, first layer first
        shape = images.shape[1:3]
        return np.stack([fuse(list(layers), shape) for layers in zip(*means, strict=True)])


def fuse(means: list[np.ndarray], shape: tuple[int, ...]) -> np.ndarray:
    """Multiply channel means (h, w) from last layer to first; enlarge to ``shape`` (H, W)."""
    product = means[-1]
    for mean in reversed(means[:-1]):
        product = _enlarge(product, mean.shape) * mean
    product = product - product.min()
    peak = float(product.max())
    normalised = product / peak if peak > 0.0 else product
    return _enlarge(normalised.astype(np.float32), shape)


def overlay(image: np.ndarray, attention: np.ndarray) -> np.ndarray:
    """The picture (H, W, 3) uint8 with its attention (H, W) in colour: the yellower, the more."""
    coloured = cv2.applyColorMap((255 * attention).astype(np.uint8), cv2.COLORMAP_VIRIDIS)
    mixed = (1.0 - ATTENTION_SHARE) * image + ATTENTION_SHARE * coloured[..., ::-1]
    return np.asarray(mixed.round().clip(0, 255), dtype=np.uint8)


def share_on(attention: np.ndarray, mask: np.ndarray) -> float:
    """How many times more attention lies on ``mask`` (H, W) bool than its area gets by chance."""
    by_chance = float(attention.sum()) * float(mask.mean())
    return float(attention[mask].sum()) / by_chance if by_chance > 0.0 else 0.0


def pictures(source: Path) -> Iterator[np.ndarray]:
    """Frames (120, 160, 3) of a folder of pictures or a video."""
    reel, index = open_reel(source), 0
    while (picture := reel.picture(index)) is not None:
        yield fit_to_frame(picture)
        index += 1


def explain(model: Path, frames: Iterable[np.ndarray]) -> Iterator[np.ndarray]:
    """For each frame (120, 160, 3): the policy's picture and its overlay, side by side."""
    explainer = Explainer(model)
    for frame in frames:
        image = preprocess(frame, explainer.contract.image)
        both = np.concatenate((image, overlay(image, explainer.attention(image[None])[0])), axis=1)
        scale = _scale(explainer.contract.image)
        yield cv2.resize(both, None, fx=scale, fy=scale, interpolation=cv2.INTER_CUBIC)


def _scale(spec: ImageSpec) -> int:
    return max(1, round(320 / spec.width_px))


def _enlarge(values: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    return cv2.resize(values, (shape[1], shape[0]), interpolation=cv2.INTER_LINEAR)


def _convolution_outputs(graph: onnx.GraphProto) -> list[str]:
    """What the rectifier after each convolution gives, first layer first."""
    rectified = {node.input[0]: node.output[0] for node in graph.node if node.op_type == "Relu"}
    convolved = [node.output[0] for node in graph.node if node.op_type == "Conv"]
    return [rectified.get(name, name) for name in convolved]
