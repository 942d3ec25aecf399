"""An ONNX file before it runs: its versions, its metadata, its inputs and outputs."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any, BinaryIO, Dict, Iterator, List, NamedTuple, Sequence, Tuple, Union

from robot.errors import ContractError

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


VARINT, FIXED64, BYTES, FIXED32 = 0, 1, 2, 5  # protocol buffer wire types
IR_VERSION, OPSET_IMPORT, METADATA_PROPS = 1, 8, 14  # fields of ModelProto
LONGEST_ENTRY_BYTES = 1 << 20  # an opset or a metadata entry; ours are a few hundred bytes


class OnnxHeader(NamedTuple):
    """Versions and metadata of a model file."""

    ir_version: int
    opset: int  # of the standard operators; 0 when the file imports none
    metadata: Dict[str, str]


def read_header(path: Union[str, Path]) -> OnnxHeader:
    """What an ONNX file says of itself, read without onnx and before onnxruntime sees the file.

    It is one protocol buffer (onnx.proto, message ModelProto). onnxruntime tells neither version,
    and meets one that is too new with a message that does not say what to do about it.

    Raises:
        ContractError: there is no such file, or it is not an ONNX model.
    """
    try:
        with open(path, "rb") as file:
            return _read_model(file)
    except OSError as error:
        raise ContractError(
            f"{path}: expected an ONNX policy, got: {error.strerror}; give the path of a "
            "model.onnx that the trainer exported"
        ) from error
    except (_NotProtobufError, UnicodeDecodeError) as error:
        raise ContractError(
            f"{path}: expected an ONNX policy, got a file that is none ({error}); copy it again, "
            "or export it again"
        ) from error


class _NotProtobufError(Exception):
    """The bytes are not those of the message."""


def _read_model(file: BinaryIO) -> OnnxHeader:
    ir_version, opset = 0, 0
    metadata: Dict[str, str] = {}
    for number, value in _fields(file):
        if number == IR_VERSION and isinstance(value, int):
            ir_version = value
        elif number == OPSET_IMPORT and isinstance(value, bytes):
            entry = _entry(value)
            if entry.get(1, b"") in (b"", b"ai.onnx"):
                opset = max(opset, int(entry.get(2, 0)))
        elif number == METADATA_PROPS and isinstance(value, bytes):
            entry = _entry(value)
            metadata[bytes(entry.get(1, b"")).decode()] = bytes(entry.get(2, b"")).decode()
    if ir_version == 0:
        raise _NotProtobufError("no IR version in it")
    return OnnxHeader(ir_version, opset, metadata)


def _entry(data: bytes) -> Dict[int, Union[int, bytes]]:
    return dict(_fields(io.BytesIO(data)))


def _fields(file: BinaryIO) -> Iterator[Tuple[int, Union[int, bytes]]]:
    """Field numbers and values of a message; nested messages of other fields are skipped."""
    end = file.seek(0, 2)
    file.seek(0)
    while file.tell() < end:
        key = _varint(file)
        number, wire = key >> 3, key & 7
        if wire == VARINT:
            yield number, _varint(file)
        elif wire in (FIXED64, FIXED32):
            file.seek(8 if wire == FIXED64 else 4, 1)
        elif wire == BYTES:
            length = _varint(file)
            if file.tell() + length > end:
                raise _NotProtobufError("cut short")
            if length <= LONGEST_ENTRY_BYTES:
                yield number, file.read(length)
            else:
                file.seek(length, 1)
        else:
            raise _NotProtobufError(f"wire type {wire}")


def _varint(file: BinaryIO) -> int:
    value = 0
    for shift in range(0, 70, 7):
        byte = file.read(1)
        if not byte:
            raise _NotProtobufError("cut short")
        value |= (byte[0] & 0x7F) << shift
        if byte[0] < 0x80:
            return value
    raise _NotProtobufError("a number of more than ten bytes")
