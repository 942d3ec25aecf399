"""From torch to the ONNX files that `robot.inference.translator` opens."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import onnx
import torch

from robot.errors import ContractError
from robot.inference.translator import OnnxTranslator, TranslatorContract
from trainer.export import IR_VERSION, OPSET
from trainer.run import atomically
from trainer.transfer.metrics import through

TOLERANCE = 1  # grey level, by which rounding may go the other way


def export_translator(network: torch.nn.Module, contract: TranslatorContract, path: Path) -> None:
    """Write one translator and compare it with torch on noise.

    Args:
        network: (N, H, W, 3) uint8 -> (N, H, W, 3) uint8, whatever is between.
        contract: goes into the file.
        path: of the file.

    Raises:
        ContractError: they disagree by more than a grey level.
    """
    network = network.cpu().eval()
    rng = np.random.default_rng(0)
    pictures = rng.integers(0, 256, (3, *contract.image.shape), dtype=np.uint8)
    axes = {name: {0: "n"} for name in ("image", "translation")}
    with atomically(path) as temporary, warnings.catch_warnings():
        # The tracer warns of sizes that it takes as fixed: here they are.
        warnings.simplefilter("ignore")
        torch.onnx.export(
            network,
            (torch.from_numpy(pictures),),
            str(temporary),
            dynamo=False,
            opset_version=OPSET,
            input_names=["image"],
            output_names=["translation"],
            dynamic_axes=axes,
        )
        model = onnx.load(str(temporary))
        model.ir_version = IR_VERSION
        onnx.helper.set_model_props(model, {TranslatorContract.METADATA_KEY: contract.to_json()})
        shape = model.graph.output[0].type.tensor_type.shape
        for axis, size in zip(shape.dim[1:], contract.image.shape, strict=True):
            axis.dim_value = size
        onnx.checker.check_model(model)
        onnx.save(model, str(temporary))
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
