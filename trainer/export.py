"""From torch to an ONNX file that a Jetson Nano loads: opset 17, IR 9, the contract inside."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import onnx
import torch
from onnxruntime import InferenceSession
from onnxruntime.quantization import CalibrationDataReader, QuantType, quantize_static
from stable_baselines3.common.policies import BasePolicy

from robot.contract import PATH_POINTS, PolicyContract
from robot.errors import ContractError
from trainer.checkpoint import TrainState
from trainer.config import RunConfig
from trainer.networks import GreedyNetwork
from trainer.run import RunFolder, atomically

OPSET = 17
IR_VERSION = 9  # onnxruntime 1.19, the last for Python 3.8, loads up to opset 21 and IR 10
TOLERANCE = 1e-4


def export_policy(
    policy: BasePolicy, config: RunConfig, folder: RunFolder, state: TrainState
) -> None:
    """Write ``model.onnx`` of a run."""
    best = state.best
    contract = PolicyContract(
        task=config.task,
        algorithm=config.algorithm,
        image=config.image,
        path_points=0 if config.task == "lane" else PATH_POINTS,
        run=folder.name,
        trained_steps=best.step if best else 0,
        score=best.success_rate if best else float("nan"),
    )
    export_network(GreedyNetwork(policy), contract, folder.onnx)


def export_network(network: GreedyNetwork, contract: PolicyContract, path: Path) -> None:
    """Write ``network`` with its contract: ``image`` uint8 (N, H, W, 3) [, ``path``] -> ``values``.

    torch's older exporter is used on purpose: the newer one needs onnxscript and cannot write
    opset 17.
    """
    inputs = ["image"] if contract.path_points == 0 else ["image", "path"]
    examples: list[torch.Tensor] = [torch.zeros((2, *contract.image.shape), dtype=torch.uint8)]
    if contract.path_points:
        examples.append(torch.zeros(2, contract.path_points))
    with atomically(path) as temporary, warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        torch.onnx.export(
            network.cpu().eval(),
            tuple(examples),
            str(temporary),
            dynamo=False,
            opset_version=OPSET,
            input_names=inputs,
            output_names=["values"],
            dynamic_axes={name: {0: "n"} for name in (*inputs, "values")},
        )
        model = onnx.load(str(temporary))
        model.ir_version = IR_VERSION
        _put_contract(model, contract)
        onnx.checker.check_model(model)
        onnx.save(model, str(temporary))


def largest_difference(network: GreedyNetwork, path: Path, batch: dict[str, np.ndarray]) -> float:
    """Between torch and onnxruntime over a batch of observations."""
    session = InferenceSession(str(path), providers=["CPUExecutionProvider"])
    (values,) = session.run(["values"], batch)
    with torch.no_grad():
        ours = network(**{name: torch.from_numpy(part) for name, part in batch.items()})
    return float(np.abs(values - ours.numpy()).max())


def check_equal(network: GreedyNetwork, path: Path, batch: dict[str, np.ndarray]) -> float:
    """The largest difference; ContractError when it is beyond `TOLERANCE`."""
    difference = largest_difference(network, path, batch)
    if not difference <= TOLERANCE:
        raise ContractError(
            f"{path}: expected torch and ONNX to agree within {TOLERANCE}, they differ by "
            f"{difference:.2e}"
        )
    return difference


def quantise(path: Path, calibration: dict[str, np.ndarray], out: Path) -> None:
    """Write an INT8 version (quantise-dequantise nodes), calibrated on these observations."""
    with atomically(out) as temporary:
        quantize_static(
            str(path),
            str(temporary),
            _Batches(calibration),
            per_channel=True,
            activation_type=QuantType.QUInt8,
            weight_type=QuantType.QInt8,
            op_types_to_quantize=["Conv", "Gemm"],
        )
        model = onnx.load(str(temporary))
        model.ir_version = IR_VERSION
        onnx.save(model, str(temporary))


class _Batches(CalibrationDataReader):
    def __init__(self, observations: dict[str, np.ndarray], size: int = 32) -> None:
        count = len(observations["image"])
        self._batches = iter(
            [
                {name: part[i : i + size] for name, part in observations.items()}
                for i in range(0, count, size)
            ]
        )

    def get_next(self) -> dict[str, np.ndarray] | None:
        return next(self._batches, None)


def _put_contract(model: onnx.ModelProto, contract: PolicyContract) -> None:
    onnx.helper.set_model_props(model, {PolicyContract.METADATA_KEY: contract.to_json()})
