"""A policy file that follows its path by pure pursuit and never looks: a network without training.

Each action has a curvature c; with the wanted curvature w the value of an action is c*w - c*c/2,
which is greatest for the nearest c. Pure pursuit (Coulter 1992) wants w = 2*angle/distance of a
point ahead.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import onnx
import onnx.parser
from onnx import TensorProto, helper, numpy_helper

from robot.contract import (
    ACTION_TWISTS,
    PATH_ANGLE_LIMIT_RAD,
    PATH_POINTS,
    ImageSpec,
    PolicyContract,
)
from robot.navigation.guidance import FIRST_POINT_M, POINT_SPACING_M

POINT = 2  # of the path input: 14 cm ahead
IMAGE = ImageSpec(80, 60, 20)


def write_pursuit(path: Path, points: int = PATH_POINTS, nan_unless_black: bool = False) -> Path:
    """Write the file.

    Args:
        path: where to.
        points: of its path input; another number than the robot's is for trying refusals.
        nan_unless_black: answer NaN to a picture whose first pixel is not black.
    """
    height, width, colours = IMAGE.shape
    graph = onnx.parser.parse_graph(
        f"""pursuit (uint8[n,{height},{width},{colours}] image, float[n,{points}] path)
        => (float[n,{len(ACTION_TWISTS)}] values) {{
            wanted = Gemm(path, weights, bias)
            pixel = Slice(image, zeros, ones, axes)
            number = Cast<to: int = {TensorProto.FLOAT}>(pixel)
            signed = {"Neg" if nan_unless_black else "Abs"}(number)
            root = Sqrt(signed)
            column = Reshape(root, flat)
            values = Add(wanted, column)
        }}"""  # a root is NaN of what is below zero
    )
    constants = _constants(points).items()
    graph.initializer.extend(numpy_helper.from_array(array, name) for name, array in constants)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
    contract = PolicyContract("navigation", "pursuit", IMAGE, points)
    helper.set_model_props(model, {PolicyContract.METADATA_KEY: contract.to_json()})
    onnx.save(model, str(path))
    return path


def _constants(points: int) -> dict[str, np.ndarray]:
    curvatures = np.array([twist.turn_radps / twist.forward_mps for twist in ACTION_TWISTS])
    distance_m = FIRST_POINT_M + POINT * POINT_SPACING_M
    weights = np.zeros((points, len(curvatures)), np.float32)
    weights[POINT] = 2.0 * PATH_ANGLE_LIMIT_RAD / distance_m * curvatures
    return {
        "weights": weights / math.pi**2,  # some scale: only the greatest value counts
        "bias": (-0.5 * curvatures**2 / math.pi**2).astype(np.float32),
        "zeros": np.zeros(3, np.int64),
        "ones": np.ones(3, np.int64),
        "axes": np.array([1, 2, 3], np.int64),
        "flat": np.array([-1, 1], np.int64),
    }
