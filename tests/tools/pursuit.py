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
from onnx import helper, numpy_helper

from robot.contract import (
    ACTION_TWISTS,
    PATH_ANGLE_LIMIT_RAD,
    PATH_POINTS,
    ImageSpec,
    PolicyContract,
)
from robot.navigation.path import FIRST_POINT_M, POINT_SPACING_M

POINT = 2  # of the path input: 14 cm ahead
IMAGE = ImageSpec(80, 60, 20)


def write_pursuit(path: Path, points: int = PATH_POINTS, drift_per_m: float = 0.0) -> Path:
    """Write the file; another number of ``points`` than the robot's is for trying refusals.

    With ``drift_per_m`` [1/m] it always wants so much more curvature: a driver to be helped.
    """
    height, width, colours = IMAGE.shape
    graph = onnx.parser.parse_graph(
        f"""pursuit (uint8[n,{height},{width},{colours}] image, float[n,{points}] path)
        => (float[n,{len(ACTION_TWISTS)}] values) {{ values = Gemm(path, weights, bias) }}"""
    )
    curvatures = np.array([twist.turn_radps / twist.forward_mps for twist in ACTION_TWISTS])
    weights = np.zeros((points, len(curvatures)))
    distance_m = FIRST_POINT_M + POINT * POINT_SPACING_M
    weights[POINT] = 2.0 * PATH_ANGLE_LIMIT_RAD / distance_m * curvatures
    bias = curvatures * (drift_per_m - 0.5 * curvatures)
    for name, array in (("weights", weights), ("bias", bias)):
        scaled = (array / math.pi**2).astype(np.float32)  # some scale: the greatest value counts
        graph.initializer.append(numpy_helper.from_array(scaled, name))
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
    contract = PolicyContract("navigation", "pursuit", IMAGE, points)
    helper.set_model_props(model, {PolicyContract.METADATA_KEY: contract.to_json()})
    onnx.save(model, str(path))
    return path
