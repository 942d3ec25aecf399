"""Frozen dataclasses to and from one JSON part: strict, small and versioned.

A receiver refuses what it does not know (schema, keys, kinds) rather than guess, and whatever bytes
come it raises nothing but ``ContractError``.
"""

import dataclasses
import json
import re
from typing import Any, Callable, ClassVar, Dict, List, Sequence, Tuple, Type, TypeVar

from robot.errors import ConfigError, ContractError, nearest
from robot.typed_config import from_plain, shown, to_plain

SCHEMA = 1
MAX_COUNT = 2**53  # integers beyond this are not the same number in a browser
DECIMALS = 6  # a micrometre, a microsecond

M = TypeVar("M", bound="Message")
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,31}")


class Checked:
    """A dataclass whose fields' metadata say what they may hold: ``NAME``, ``number`` and so on."""

    def __post_init__(self) -> None:
        for each in dataclasses.fields(self):  # type: ignore[arg-type]
            for check in each.metadata.values():
                check(f"{type(self).__name__}.{each.name}", getattr(self, each.name))


class Message(Checked):
    """A frozen dataclass that is one JSON part; ``KIND`` is its name on the wire."""

    KIND: ClassVar[str]
    LIMIT_BYTES: ClassVar[int] = 4096

    def to_bytes(self) -> bytes:
        """UTF-8 JSON with name and ``schema``, numbers to six decimals; ContractError: too long."""
        fields = {"schema": SCHEMA, "message": self.KIND, **plain(self)}
        text = json.dumps(fields, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
        data = text.encode()
        require_size(f"{self.KIND} message", data, self.LIMIT_BYTES)
        return data

    @classmethod
    def from_bytes(cls: Type[M], data: bytes) -> M:
        """What ``to_bytes`` wrote; ContractError for anything else, or a value out of range."""
        name = cls.KIND
        require_size(f"{name} message", data, cls.LIMIT_BYTES)
        try:
            fields = json.loads(data.decode("utf-8"), object_pairs_hook=_unique)
        except (ValueError, RecursionError) as error:
            raise ContractError(f"{name} message: expected JSON, got: {error}") from error
        if not isinstance(fields, dict):
            raise ContractError(f"{name} message: expected an object, got {shown(fields)}")
        for key, expected in (("schema", SCHEMA), ("message", name)):
            got = fields.pop(key, None)
            if got != expected or isinstance(got, bool):
                raise ContractError(f"{name}: expected {key} {expected!r}, got {shown(got)}")
        try:
            return from_plain(cls, fields, where=name)
        except (ConfigError, OverflowError) as error:
            raise ContractError(str(error)) from error


def require_size(what: str, data: bytes, limit_bytes: int) -> None:
    """Refuse what is larger than its channel allows."""
    if len(data) > limit_bytes:
        raise ContractError(f"{what}: expected at most {limit_bytes} bytes, got {len(data)}")


def _metadata(check: Callable[..., None]) -> Callable[..., Dict[str, Callable[[str, Any], None]]]:
    """Metadata of a field: with these arguments, check its name and its value."""
    return lambda *told: {check.__name__: lambda what, value: check(what, value, *told)}


@_metadata
def number(what: str, value: Any, low: float, high: float) -> None:
    """A number in [low, high], which no NaN is in, or None; or a list of such, or of lists."""
    if isinstance(value, tuple):
        for each in value:
            number(low, high)["number"](what, each)
    elif value is not None and not low <= value <= high:
        raise ContractError(f"{what}: expected a number in [{low:g}, {high:g}], got {value!r:.40}")


@_metadata
def entries(what: str, value: Tuple[Any, ...], most: int) -> None:
    """At most so many entries."""
    if len(value) > most:
        raise ContractError(f"{what}: expected at most {most} entries, got {len(value)}")


@_metadata
def text(what: str, value: str, limit_bytes: int) -> None:
    """Printable text that is not too long, without control characters or lone surrogates."""
    size = len(value.encode("utf-8", "replace"))
    if size > limit_bytes or not all(c.isprintable() for c in value):
        raise ContractError(
            f"{what}: expected at most {limit_bytes} bytes of printable text, got {shown(value)}"
        )


@_metadata
def one_of(what: str, value: str, valid: Sequence[str]) -> None:
    """A word of the list."""
    if value not in valid:
        raise ContractError(f"{what}: unknown {shown(value)}; {nearest(value[:40], valid)}")


@_metadata
def name(what: str, value: str) -> None:
    """A short identifier of letters, digits, '.', '_' and '-'."""
    if not _NAME.fullmatch(value):
        raise ContractError(f"{what}: expected 1 to 32 letters, digits or ._-, got {shown(value)}")


NAME, COUNT, TIME_S = name(), number(0, MAX_COUNT), number(0.0, 1e10)


def tidy_text(text: str, limit_bytes: int) -> str:
    """The same text on one line, printable and cut to ``limit_bytes``: what a message takes."""
    line = "".join(c if c.isprintable() else "?" for c in " ".join(text.split()))
    return line.encode("utf-8")[:limit_bytes].decode("utf-8", "ignore")


def plain(value: Any) -> Any:
    """A message as dicts, lists and scalars for JSON; numbers keep six decimals."""
    return to_plain(value, DECIMALS)


def _unique(pairs: List[Tuple[str, Any]]) -> Dict[str, Any]:
    fields = dict(pairs)
    if len(fields) != len(pairs):
        raise ValueError("a key twice")
    return fields
