"""What an ONNX file says of itself, read without onnx and before onnxruntime sees the file."""

from __future__ import annotations

import io
from pathlib import Path
from typing import BinaryIO, Dict, Iterator, NamedTuple, Tuple, Union

from robot.errors import ContractError

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
