"""An ONNX file as a network: loaded, its metadata read, its inputs and outputs compared."""

from pathlib import Path
from typing import Any, Generic, NamedTuple, Tuple, Type, TypeVar, Union

import numpy as np

from robot.contract import InFile
from robot.errors import ContractError, DuckpilotError

File = Union[str, Path]
T = TypeVar("T", bound=InFile)
BYTES, FLOATS = "tensor(uint8)", "tensor(float)"


class Tensor(NamedTuple):
    """An input or output of a network: onnxruntime's word for its kind, and its axes."""

    name: str
    kind: str
    axes: Tuple[Union[int, str, None], ...]  # a name or None is an axis of any size

    def __str__(self) -> str:
        axes = ", ".join("N" if axis is None else str(axis) for axis in self.axes)
        return f"{self.name} {self.kind} ({axes})"

    def fits(self, got: "Tensor") -> bool:
        """Whether ``got`` is this tensor, with a free batch axis; other free axes may be ours."""
        return (
            got.kind == self.kind
            and len(got.axes) == len(self.axes)
            and not isinstance(got.axes[0], int)
            and all(g == a for g, a in zip(got.axes[1:], self.axes[1:]) if isinstance(g, int))
        )


def open_network(path: File, remedy: str) -> Any:
    """An onnxruntime session of a file. Its one thread is as fast as four for our networks, and
    leaves the other cores of a Jetson Nano to the camera and the motors.

    ContractError, which ends with the ``remedy``: it is absent, damaged, or too new for this one.
    """
    import onnxruntime as ort
    from onnxruntime.capi import onnxruntime_pybind11_state as state

    options = ort.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = 4  # its errors come as exceptions; its warnings are not for users
    # onnxruntime's exceptions share no base class of its own; it quotes damaged names as they are.
    damaged = (state.Fail, state.InvalidGraph, state.InvalidProtobuf, state.InvalidArgument)
    unsupported = (state.NotImplemented, state.RuntimeException)
    try:
        return ort.InferenceSession(
            Path(path).read_bytes(), options, providers=["CPUExecutionProvider"], enable_fallback=0
        )
    except OSError as error:
        told = error.strerror
    except (*damaged, *unsupported, ValueError) as error:  # also of a name that no file can have
        told = f"a file that onnxruntime {ort.__version__} does not load ({str(error).strip()})"
    raise ContractError(f"{path}: expected an ONNX policy, got: {told}; {remedy}")


class Network(Generic[T]):
    """An ONNX file with a contract of this ``kind``, which answers pictures with one output.

    Errors end with the ``remedy``. ContractError: as of ``open_network``, or no such contract.
    """

    def __init__(self, path: File, kind: Type[T], remedy: str) -> None:
        self.path = Path(path)
        self._session, self._remedy = open_network(path, remedy), remedy
        key = kind.METADATA_KEY
        try:
            metadata = self._session.get_modelmeta().custom_metadata_map
            if key not in metadata:
                raise ContractError(f"expected metadata under {key!r}, got keys {sorted(metadata)}")
            self.contract = kind.from_json(metadata[key])
        except (DuckpilotError, UnicodeDecodeError) as error:
            raise ContractError(f"{path}: {error}; {remedy}") from error

    def expect(self, shape: Tuple[int, ...], output: Tensor, *others: Tensor) -> None:
        """ContractError unless pictures of this shape and ``others`` give ``output``, only."""
        self._shape, self._output = shape, output.name
        inputs = (Tensor("image", BYTES, (None, *shape)), *others)
        for role, expected, nodes in (
            ("inputs", inputs, self._session.get_inputs()),
            ("outputs", (output,), self._session.get_outputs()),
        ):
            got = {node.name: Tensor(node.name, node.type, tuple(node.shape)) for node in nodes}
            same = set(got) == {tensor.name for tensor in expected}
            if not (same and all(tensor.fits(got[tensor.name]) for tensor in expected)):
                wanted, found = ("; ".join(map(str, some)) for some in (expected, got.values()))
                raise ContractError(
                    f"{self.path}: expected {role} {wanted}, got {found or 'none'}; {self._remedy}"
                )

    def answer(self, pictures: np.ndarray, **others: np.ndarray) -> np.ndarray:
        """The output for pictures (N, H, W, 3 frames) uint8 RGB; ContractError for others."""
        if pictures.ndim != 4 or pictures.shape[1:] != self._shape or pictures.dtype != np.uint8:
            raise ContractError(
                f"pictures: expected (N, {', '.join(map(str, self._shape))}) uint8, got "
                f"{pictures.shape} {pictures.dtype}; make them for {self.path.name} with "
                "preprocess(frame, contract.image)"
            )
        feeds = {"image": np.ascontiguousarray(pictures), **others}
        try:
            return np.asarray(self._session.run([self._output], feeds)[0])
        except Exception as error:  # of onnxruntime's, which share no base class
            told = f"expected an answer, got: {str(error).strip()}; {self._remedy}"
            raise ContractError(f"{self.path}: {told}") from error
