"""Frozen dataclasses to and from plain data (YAML, JSON); unknown keys and wrong kinds are refused.

Understands nested dataclasses, float, int, bool, str, tuples, Optional and unions of these: all
that a configuration file of ours holds.
"""

from __future__ import annotations

import dataclasses
import functools
import reprlib
import typing
from pathlib import Path
from typing import Any, Dict, Tuple, Type, TypeVar, Union

from robot.errors import ConfigError, nearest

T = TypeVar("T")

MOST_YAML_BYTES = 4_000_000


def to_plain(value: Any) -> Any:
    """A dataclass as dicts, lists and scalars, ready for YAML or JSON."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {f.name: to_plain(getattr(value, f.name)) for f in dataclasses.fields(value)}
    if isinstance(value, (list, tuple)):
        return [to_plain(item) for item in value]
    return value


def from_plain(kind: Type[T], data: Any, where: str = "") -> T:
    """Build the dataclass ``kind`` from plain data; absent keys keep their defaults.

    ConfigError: naming the key, what was expected and, for an unknown key, the nearest one.
    """
    label = where or kind.__name__
    if not isinstance(data, dict):
        raise ConfigError(f"{label}: expected a mapping of settings, got {_told(data)}")
    fields = {f.name: f for f in dataclasses.fields(kind)}  # type: ignore[arg-type]
    hints = _type_hints(kind)  # type: ignore[arg-type]
    values: Dict[str, Any] = {}
    for key, item in data.items():
        if key not in fields:
            raise ConfigError(
                f"{label}: unknown key {_told(key)}; {nearest(str(key)[:80], fields)}"
            )
        values[key] = _convert(hints[key], item, f"{label}.{key}")
    missing = [f.name for f in fields.values() if f.name not in values and _is_required(f)]
    if missing:
        raise ConfigError(f"{label}: missing {', '.join(missing)}")
    return kind(**values)


def _is_required(field: Any) -> bool:
    return field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING


def load_yaml(kind: Type[T], path: Union[str, Path]) -> T:
    """Read one dataclass from a YAML file.

    ConfigError: the file is absent, is not YAML, or does not fit ``kind``.
    """
    return from_plain(kind, read_yaml(path), where=str(path))


def read_yaml(path: Union[str, Path]) -> Any:
    """The plain data of a YAML file ({} for an empty one); ConfigError when absent or malformed."""
    import yaml

    try:
        if Path(path).stat().st_size > MOST_YAML_BYTES:
            raise ConfigError(f"{path}: expected a YAML file of at most {MOST_YAML_BYTES} bytes")
        text = Path(path).read_text(encoding="utf-8")
    except OSError as error:
        raise ConfigError(
            f"{path}: expected a readable YAML file, got: {error.strerror}"
        ) from error
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path}: expected a YAML file in UTF-8, got: {error}") from error
    try:
        return yaml.safe_load(text) or {}
    except (yaml.YAMLError, ValueError, RecursionError) as error:  # ValueError: 2026-99-99
        told = " ".join(str(error).split())
        raise ConfigError(f"{path}: expected YAML, got: {told}") from error


def _told(value: Any) -> str:
    """Short, whatever it is: a few lines of YAML with aliases may stand for gigabytes."""
    return _REPR.repr(value)


_REPR = reprlib.Repr()
_REPR.maxstring = _REPR.maxother = 80


@functools.lru_cache(maxsize=None)
def _type_hints(kind: type) -> Dict[str, Any]:
    """Resolving the annotations takes longer than all the rest, and messages come often."""
    return typing.get_type_hints(kind)


def _convert(kind: Any, value: Any, label: str) -> Any:
    origin = typing.get_origin(kind)
    if origin is Union or type(kind).__name__ == "UnionType":  # the latter: A | B, Python 3.10
        return _convert_union(kind, value, label)
    if isinstance(kind, type) and dataclasses.is_dataclass(kind):
        return from_plain(kind, value, label)
    if origin in (tuple, list):
        return _convert_sequence(kind, value, label)
    if kind is Any:
        return value
    if origin is typing.Literal:
        if value not in typing.get_args(kind):
            valid = nearest(str(value)[:80], typing.get_args(kind))
            raise ConfigError(f"{label}: unknown {_told(value)}; {valid}")
        return value
    return _convert_scalar(kind, value, label)


def _convert_union(kind: Any, value: Any, label: str) -> Any:
    members = typing.get_args(kind)
    if value is None and type(None) in members:
        return None
    problems = []
    for member in members:
        if member is type(None):
            continue
        try:
            return _convert(member, value, label)
        except ConfigError as error:
            problems.append(str(error))
    raise ConfigError("; or ".join(problems))


def _convert_sequence(kind: Any, value: Any, label: str) -> Tuple[Any, ...]:
    if not isinstance(value, (list, tuple)):
        raise ConfigError(f"{label}: expected a list, got {_told(value)}")
    members = typing.get_args(kind)
    if (len(members) == 2 and members[1] is Ellipsis) or typing.get_origin(kind) is list:
        return tuple(_convert(members[0], v, f"{label}[{i}]") for i, v in enumerate(value))
    if len(members) != len(value):
        got = f"{len(value)}: {_told(value)}"
        raise ConfigError(f"{label}: expected {len(members)} values, got {got}")
    return tuple(_convert(m, v, f"{label}[{i}]") for i, (m, v) in enumerate(zip(members, value)))


def _convert_scalar(kind: Any, value: Any, label: str) -> Any:
    if kind is float and isinstance(value, (int, float)) and not isinstance(value, bool):
        return float(value)
    if kind is int and isinstance(value, int) and not isinstance(value, bool):
        return value
    if kind in (bool, str) and isinstance(value, kind):
        return value
    name = getattr(kind, "__name__", str(kind))
    raise ConfigError(f"{label}: expected {name}, got {_told(value)} ({type(value).__name__})")
