"""Tiny policies for the tests, also where the onnx package is absent (Python 3.8).

The committed networks say nothing of themselves. Protocol buffers merge when their bytes are
joined, so metadata, or a wrong version, is appended to them. The networks choose by the picture's
mean colour: red LEFT, green SLIGHT_LEFT, blue and black STRAIGHT; the one that has a path turns
slightly to the side of its mean angle when the picture is black.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Dict

import numpy as np
import pytest

from robot.contract import PATH_POINTS, PolicyContract
from robot.inference.policy import TranslatorContract

FIXTURES = Path(__file__).parent / "fixtures"
COLOUR_WEIGHTS = np.eye(3, 5, dtype=np.float32)
BIAS = np.array([0.0, 0.0, 0.01, 0.0, 0.0], dtype=np.float32)


def lane_contract(**changes: Any) -> PolicyContract:
    return PolicyContract("lane", "ddqn", **changes)


def navigation_contract(**changes: Any) -> PolicyContract:
    return PolicyContract("navigation", "ppo", path_points=PATH_POINTS, **changes)


def write_policy(path: Path, contract: PolicyContract, ir_version: int = 0, opset: int = 0) -> Path:
    """A good policy file for the contract, or one that claims other versions."""
    name = "navigation.onnx" if contract.told else "lane.onnx"
    return write_network(
        path,
        (FIXTURES / name).read_bytes(),
        {PolicyContract.METADATA_KEY: contract.to_json()},
        ir_version,
        opset,
    )


def write_network(
    path: Path, network: bytes, metadata: Dict[str, str], ir_version: int = 0, opset: int = 0
) -> Path:
    for key, text in metadata.items():
        network += _field(14, _field(1, key.encode()) + _field(2, text.encode()))
    if opset:
        network += _field(8, b"\x10" + _varint(opset))
    if ir_version:
        network += b"\x08" + _varint(ir_version)
    path.write_bytes(network)
    return path


def build_network(
    path_points: int = 0,
    actions: int = 5,
    image_kind: str = "UINT8",
    output: str = "values",
    batch: Any = "N",
    scale: float = 1.0 / 255.0,
) -> bytes:
    """A network built with the onnx package: skips the test where that is absent."""
    onnx = pytest.importorskip("onnx")
    helper, kind = onnx.helper, onnx.TensorProto
    path_weights = np.zeros((path_points, actions), np.float32)
    path_weights[:, 1:4:2] = 0.1, -0.1
    weights = np.concatenate((np.resize(COLOUR_WEIGHTS, (3, actions)), path_weights))
    if actions == 5:
        weights[:3] = COLOUR_WEIGHTS
    constants = {"scale": np.float32(scale), "W": weights, "b": np.resize(BIAS, actions)}
    nodes = [
        helper.make_node("Cast", ["image"], ["float"], to=kind.FLOAT),
        helper.make_node("ReduceMean", ["float"], ["mean"], axes=[1, 2], keepdims=0),
        helper.make_node("Mul", ["mean", "scale"], ["colour"]),
        helper.make_node("Concat", ["colour", "path"][: 1 + bool(path_points)], ["x"], axis=1),
        helper.make_node("MatMul", ["x", "W"], ["y"]),
        helper.make_node("Add", ["y", "b"], [output]),
    ]
    info = helper.make_tensor_value_info
    inputs = [info("image", getattr(kind, image_kind), [batch, "H", "W", 3])]
    if path_points:
        inputs.append(info("path", kind.FLOAT, [batch, path_points]))
    graph = helper.make_graph(
        nodes,
        "tiny",
        inputs,
        [info(output, kind.FLOAT, [batch, actions])],
        [onnx.numpy_helper.from_array(np.asarray(v), k) for k, v in constants.items()],
    )
    opset = helper.make_opsetid("", 17)
    model = helper.make_model(graph, ir_version=9, opset_imports=[opset], producer_name="tests")
    return model.SerializeToString()  # type: ignore[no-any-return]


def _varint(value: int) -> bytes:
    out = bytearray()
    while value > 0x7F:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes(out) + bytes([value])


def _field(number: int, payload: bytes) -> bytes:
    return _varint(number << 3 | 2) + _varint(len(payload)) + payload


def write_translator(path: Path, contract: TranslatorContract) -> Path:
    """A translator that makes each picture its negative; skips where onnx is absent."""
    onnx = pytest.importorskip("onnx")
    helper, kind = onnx.helper, onnx.TensorProto
    tensor = helper.make_tensor_value_info
    white = onnx.numpy_helper.from_array(np.float32(255), "white")
    graph = helper.make_graph(
        [
            helper.make_node("Cast", ["image"], ["float"], to=kind.FLOAT),
            helper.make_node("Sub", ["white", "float"], ["negative"]),
            helper.make_node("Cast", ["negative"], ["translation"], to=kind.UINT8),
        ],
        "negative",
        [tensor("image", kind.UINT8, ["N", "H", "W", 3])],
        [tensor("translation", kind.UINT8, ["N", "H", "W", 3])],
        [white],
    )
    opset = helper.make_opsetid("", 17)
    model = helper.make_model(graph, ir_version=9, opset_imports=[opset])
    metadata = {TranslatorContract.METADATA_KEY: contract.to_json()}
    return write_network(path, model.SerializeToString(), metadata)
