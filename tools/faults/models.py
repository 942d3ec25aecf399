"""The policy's file: missing, damaged, of another contract, answering NaN, slow."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

from robot.contract import ACTION_WHEELS, PATH_POINTS, ImageSpec, PolicyContract
from tools.faults.case import Act, Case
from tools.faults.stage import Stage

SLOW_S = 0.35
IMAGE = ImageSpec(80, 60, 20)


def _starts_with(make: Callable[[Stage], Path]) -> Act:
    def inject(stage: Stage) -> None:
        bench = stage.bench
        bench.stop("robot")
        bench.use_model(make(stage))
        bench.start_and_end("robot")

    return inject


def _own_model(stage: Stage) -> None:
    stage.bench.use_model(stage.bench.options.model)


def _refused(says: str) -> Callable[[Stage], str]:
    def check(stage: Stage) -> str:
        process = stage.bench.processes["robot"]
        code, last = process.child.returncode, process.said().strip().splitlines()[-1]
        if code != 2 or says not in last:
            return f"expected status 2 and a line with {says!r}, got {code}: {last}"
        return ""

    return check


def _missing(stage: Stage) -> Path:
    return stage.bench.folder / "none.onnx"


def _damaged(stage: Stage) -> Path:
    path = stage.bench.folder / "damaged.onnx"
    data = bytearray(stage.bench.options.model.read_bytes())
    data[100:2000] = bytes(1900)
    path.write_bytes(data)
    return path


def _of_another_contract(stage: Stage) -> Path:
    path = stage.bench.folder / "other.onnx"
    write_policy(path, PolicyContract("navigation", "none", IMAGE, 7, score=0.0), 7)
    return path


def _answers_nan(stage: Stage) -> None:
    """Drives straight on; NaN as soon as the picture's first pixel is not black."""
    bench = stage.bench
    path = bench.folder / "nan.onnx"
    write_policy(path, PolicyContract("navigation", "none", IMAGE, PATH_POINTS, score=0.0))
    see = bench.town.world.see

    def first_pixel_black() -> np.ndarray:
        picture = see()
        picture[38:46, :6] = 0
        return picture

    bench.town.camera.see = first_pixel_black
    bench.stop("robot")
    bench.use_model(path)
    bench.revive()
    stage.ready()


def _show_all(stage: Stage) -> None:
    stage.bench.town.camera.see = stage.bench.town.world.see


def _own_model_again(stage: Stage) -> None:
    _show_all(stage)
    if stage.bench.model != stage.bench.options.model:
        stage.bench.stop("robot")
        _own_model(stage)


def _slow(stage: Stage) -> None:
    stage.bench.time.slow(SLOW_S)


def _fast(stage: Stage) -> None:
    stage.bench.time.slow(0.0)


def write_policy(path: Path, contract: PolicyContract, points: int = PATH_POINTS) -> None:
    """A network that prefers straight on, and answers NaN unless the first pixel is black."""
    height, width, colours = IMAGE.shape
    image = helper.make_tensor_value_info("image", TensorProto.UINT8, ["n", height, width, colours])
    way = helper.make_tensor_value_info("path", TensorProto.FLOAT, ["n", points])
    values = helper.make_tensor_value_info("values", TensorProto.FLOAT, ["n", len(ACTION_WHEELS)])
    weights = np.zeros((points, len(ACTION_WHEELS)), np.float32)
    constants = {
        "weights": weights,
        "bias": np.eye(len(ACTION_WHEELS), dtype=np.float32)[2],
        "zeros": np.zeros(3, np.int64),
        "ones": np.ones(3, np.int64),
        "axes": np.array([1, 2, 3], np.int64),
        "flat": np.array([-1, 1], np.int64),
    }
    nodes = [
        helper.make_node("Gemm", ["path", "weights", "bias"], ["straight"]),
        helper.make_node("Slice", ["image", "zeros", "ones", "axes"], ["pixel"]),
        helper.make_node("Cast", ["pixel"], ["number"], to=TensorProto.FLOAT),
        helper.make_node("Neg", ["number"], ["negative"]),
        helper.make_node("Sqrt", ["negative"], ["broken"]),  # NaN of what is below zero
        helper.make_node("Reshape", ["broken", "flat"], ["column"]),
        helper.make_node("Add", ["straight", "column"], ["values"]),
    ]
    held = [numpy_helper.from_array(array, name) for name, array in constants.items()]
    graph = helper.make_graph(nodes, "policy", [image, way], [values], held)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
    entry = model.metadata_props.add()
    entry.key, entry.value = PolicyContract.METADATA_KEY, contract.to_json()
    onnx.save(model, str(path))


_START = {"moving": False, "silent": True, "heal": _own_model}

CASES = (
    Case("missing", "no such file", _starts_with(_missing), check=_refused("none.onnx"), **_START),  # type: ignore[arg-type]
    Case("damaged", "bytes overwritten", _starts_with(_damaged), check=_refused("onnx"), **_START),  # type: ignore[arg-type]
    Case(
        *("wrong contract", "seven path points", _starts_with(_of_another_contract)),
        check=_refused("path"),
        **_START,  # type: ignore[arg-type]
    ),
    Case(
        *("NaN", "it answers NaN to some pictures", _show_all),
        threshold_s=0.1,
        says="finite",
        before=_answers_nan,
        heal=_own_model_again,
    ),
    Case(
        *("slow", f"a decision takes {SLOW_S:g} s", _slow),
        threshold_s=0.2,
        says="loop|frame",
        heal=_fast,
    ),
)
