"""Files that torch writes: a damaged one, or one of something else, is wrong input."""

import pickle
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import torch

from robot.command_line import one_line
from robot.errors import ConfigError
from robot.output import atomically

_DAMAGED = (
    RuntimeError,  # torch's for a truncated archive, and for weights of another shape
    EOFError,
    LookupError,
    TypeError,
    AttributeError,
    UnicodeDecodeError,
    pickle.UnpicklingError,
)


@contextmanager
def reading(path: Path, what: str, remedy: str = "") -> Iterator[None]:
    """ConfigError for whatever fails in the block: the file is absent, damaged, or something else.

    ``what`` it should be, such as "a parser"; ``remedy``: what a person can do.
    """
    try:
        yield
    except OSError as error:
        raise ConfigError(f"{path}: expected {what}, got: {error.strerror}{remedy}") from error
    except _DAMAGED as error:
        told = one_line(str(error))[:100]
        raise ConfigError(
            f"{path}: expected {what}, got a damaged file or another ({told}){remedy}"
        ) from error


@contextmanager
def loaded(path: Path, what: str, device: Any = "cpu", remedy: str = "") -> Iterator[Any]:
    """What `save_torch` wrote; ConfigError as of `reading`."""
    with reading(path, what, remedy):
        yield torch.load(path, map_location=device, weights_only=True)


def save_torch(path: Path, content: Any) -> None:
    """Write plain data and tensors, whole or not at all."""
    with atomically(path) as temporary:
        torch.save(content, temporary)
