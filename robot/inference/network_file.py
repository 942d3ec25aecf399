"""An ONNX file before it runs: its versions, its metadata, its inputs and outputs."""

from __future__ import annotations

from pathlib import Path
from typing import Any, List, NamedTuple, Sequence, Tuple, Union

from robot.errors import ContractError
from robot.inference.onnx_header import read_header

# onnxruntime 1.19.2, the newest for a Jetson Nano, loads no later file (measured).
MAX_IR_VERSION = 10
MAX_OPSET = 21


class Tensor(NamedTuple):
    """An input or output of a network: onnxruntime's word for its kind, and its axes."""

    name: str
    kind: str
    axes: Tuple[Union[int, str, None], ...]  # a name or None is an axis of any size

    def __str__(self) -> str:
        axes = ", ".join("N" if axis is None else str(axis) for axis in self.axes)
        return f"{self.name} {self.kind} ({axes})"

    def fits(self, got: Tensor) -> bool:
        """Whether ``got`` is this tensor, with a free batch axis; other free axes may be ours."""
        return (
            got.kind == self.kind
            and len(got.axes) == len(self.axes)
            and not isinstance(got.axes[0], int)
            and all(g == a for g, a in zip(got.axes[1:], self.axes[1:]) if isinstance(g, int))
        )


def read_metadata(path: Union[str, Path], key: str, remedy: str) -> str:
    """The text under ``key`` of a file whose versions the robot can load.

    Args:
        path: the ONNX file.
        key: of the metadata entry.
        remedy: what a person does about a wrong file, to end the message with.

    Raises:
        ContractError: the file is absent, no ONNX model, too new, or has no such entry.
    """
    header = read_header(path)
    for name, got, most in (
        ("IR version", header.ir_version, MAX_IR_VERSION),
        ("opset", header.opset, MAX_OPSET),
    ):
        if not 1 <= got <= most:
            raise ContractError(
                f"{path}: expected {name} 1 to {most}, got {got}; the robot's onnxruntime loads no "
                f"other: {remedy}"
            )
    text = header.metadata.get(key)
    if text is None:
        raise ContractError(
            f"{path}: expected metadata under {key!r}, got keys {sorted(header.metadata)}; {remedy}"
        )
    return text


def open_network(
    path: Path, inputs: List[Tensor], outputs: List[Tensor], threads: int, remedy: str
) -> Any:
    """An onnxruntime session with these inputs and outputs, on the processor.

    Args:
        path: the ONNX file.
        inputs: all of them.
        outputs: all of them.
        threads: of one inference.
        remedy: what a person does about a wrong file, to end the message with.

    Raises:
        ContractError: onnxruntime cannot load the file, or its inputs or outputs are others.
    """
    import onnxruntime as ort
    from onnxruntime.capi import onnxruntime_pybind11_state as state

    options = ort.SessionOptions()
    options.intra_op_num_threads = threads
    options.inter_op_num_threads = 1
    options.log_severity_level = 3  # its errors come as exceptions; its warnings are not for users
    # onnxruntime's exceptions share no base class of its own; it quotes damaged names as they are.
    damaged = (state.Fail, state.InvalidGraph, state.InvalidProtobuf, state.InvalidArgument)
    garbled = (UnicodeDecodeError,)
    unsupported = (state.NotImplemented, state.RuntimeException, state.NoSuchFile)
    try:
        session = ort.InferenceSession(
            str(path), options, providers=["CPUExecutionProvider"], enable_fallback=0
        )
    except (*damaged, *garbled, *unsupported) as error:
        raise ContractError(
            f"{path}: expected a model that onnxruntime {ort.__version__} loads, got: "
            f"{str(error).strip()}; {remedy}"
        ) from error
    _check_tensors(path, "inputs", inputs, session.get_inputs(), remedy)
    _check_tensors(path, "outputs", outputs, session.get_outputs(), remedy)
    return session


def _check_tensors(
    path: Path, role: str, expected: List[Tensor], nodes: Sequence[Any], remedy: str
) -> None:
    got = {node.name: Tensor(node.name, node.type, tuple(node.shape)) for node in nodes}
    same = set(got) == {tensor.name for tensor in expected}
    if not (same and all(tensor.fits(got[tensor.name]) for tensor in expected)):
        raise ContractError(
            f"{path}: expected {role} {'; '.join(map(str, expected))}, "
            f"got {'; '.join(map(str, got.values())) or 'none'}; {remedy}"
        )
