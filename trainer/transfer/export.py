"""From torch to the ONNX files that `robot.inference.translator` opens."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch

from robot.errors import ContractError
from robot.inference.translator import OnnxTranslator, TranslatorContract
from trainer.export import write_onnx
from trainer.run import atomically
from trainer.transfer.metrics import through

TOLERANCE = 1  # grey level, by which rounding may go the other way


def export_translator(network: torch.nn.Module, contract: TranslatorContract, path: Path) -> None:
    """Write a network (N, H, W, 3) uint8 -> the same; compare the file with torch on noise.

    Raises:
        ContractError: they disagree by more than a grey level.
    """
    rng = np.random.default_rng(0)
    pictures = rng.integers(0, 256, (3, *contract.image.shape), dtype=np.uint8)
    example = {"image": torch.from_numpy(pictures)}
    with atomically(path) as temporary:
        write_onnx(network, example, "translation", contract, temporary, contract.image.shape)
        _check_equal(network, OnnxTranslator(temporary), pictures)


def _check_equal(network: torch.nn.Module, exported: OnnxTranslator, pictures: np.ndarray) -> None:
    ours = through(network, pictures)
    theirs = np.concatenate([exported(part) for part in (pictures[:1], pictures[1:])])
    difference = int(np.abs(theirs.astype(int) - ours.astype(int)).max())
    if difference > TOLERANCE:
        raise ContractError(
            f"{exported.path}: expected torch and ONNX to agree within {TOLERANCE} grey level, "
            f"they differ by {difference}"
        )
