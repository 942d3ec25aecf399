"""Frozen dataclasses to and from plain data (YAML, JSON); unknown keys and wrong kinds are refused.

Understands nested dataclasses, float, int, bool, str, bytes (in base64), tuples, Optional and
unions of these: all that a configuration file or a message of ours holds.
"""

import base64
import contextlib
import dataclasses
import functools
import json
import reprlib
import sys
import typing
from pathlib import Path
from typing import Any, Dict, Mapping, Optional, Tuple, Type, TypeVar, Union

from robot.errors import ConfigError, nearest

T = TypeVar("T")

MOST_YAML_BYTES = 4_000_000
_short = reprlib.Repr()
_short.maxstring = _short.maxother = 80
# Resolving the annotations takes longer than all the rest, and messages come often.
_type_hints = functools.lru_cache(maxsize=None)(typing.get_type_hints)
shown = _short.repr  # whatever it is: a few lines of YAML with aliases may stand for gigabytes


def to_plain(value: Any, decimals: Optional[int] = None) -> Any:
    """A dataclass as dicts, lists and scalars, ready for YAML or JSON; bytes as base64.

    Numbers keep so many ``decimals``, or all of them.
    """
    if type(value) is float:  # first, because a message is mostly these
        return value if decimals is None else round(value, decimals)
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = dataclasses.fields(value)
        return {f.name: to_plain(getattr(value, f.name), decimals) for f in fields}
    if isinstance(value, (list, tuple)):
        return [to_plain(item, decimals) for item in value]
    if isinstance(value, bytes):
        return base64.b64encode(value).decode("ascii")
    return to_plain(value.item(), decimals) if hasattr(value, "item") else value  # of NumPy


def from_plain(kind: Type[T], data: Any, where: str = "") -> T:
    """Build the dataclass ``kind`` from plain data; absent keys keep their defaults.

    ConfigError: naming the key, what was expected and, for an unknown key, the nearest one.
    """
    label = where or kind.__name__
    if not isinstance(data, dict):
        raise ConfigError(f"{label}: expected a mapping of settings, got {shown(data)}")
    fields = {f.name: f for f in dataclasses.fields(kind)}  # type: ignore[arg-type]
    hints = _type_hints(kind)  # type: ignore[arg-type]
    values: Dict[str, Any] = {}
    for key, item in data.items():
        if key not in fields:
            near = nearest(str(key)[:80], fields)
            raise ConfigError(f"{label}: unknown key {shown(key)}; {near}")
        values[key] = _convert(hints[key], item, f"{label}.{key}")
    unset = dataclasses.MISSING
    needed = [f.name for f in fields.values() if f.default is unset is f.default_factory]
    missing = [name for name in needed if name not in values]
    if missing:
        raise ConfigError(f"{label}: missing {', '.join(missing)}")
    return kind(**values)


def named_file(kind: str, source: Union[str, Path], shipped: Mapping[str, Path]) -> Path:
    """A path that exists, or else the shipped one of that name; ConfigError for neither."""
    path = Path(source)
    if not path.exists() and str(source) not in shipped:
        raise ConfigError(f"{kind} {str(source)!r}: no such file; {nearest(str(source), shipped)}")
    return path if path.exists() else shipped[str(source)]


def load_yaml(kind: Type[T], path: Union[str, Path]) -> T:
    """One dataclass from a YAML file; ConfigError: it is absent, not YAML, or does not fit."""
    return from_plain(kind, read_yaml(path), where=str(path))


def read_yaml(path: Union[str, Path]) -> Any:
    """The plain data of a YAML file ({} for an empty one); ConfigError when absent or malformed."""
    import yaml

    try:
        if Path(path).stat().st_size > MOST_YAML_BYTES:
            raise ConfigError(f"{path}: expected a YAML file of at most {MOST_YAML_BYTES} bytes")
        return yaml.load(Path(path).read_text(encoding="utf-8"), _yaml_loader()) or {}
    except ConfigError:
        raise
    except OSError as error:
        told = f"{path}: expected a readable YAML file, got: {error.strerror}"
        raise ConfigError(told) from error
    # What PyYAML lets pass: 2026-99-99, !!bool x, !!int '', !!timestamp x.
    except (yaml.YAMLError, ValueError, LookupError, AttributeError, RecursionError) as error:
        told = " ".join(str(error).split())
        raise ConfigError(f"{path}: expected YAML in UTF-8, got: {told}") from error


@functools.lru_cache(maxsize=None)
def _yaml_loader() -> Any:
    """PyYAML's safe loader; it would take the last of a key given twice without a word."""
    import yaml

    class Loader(yaml.SafeLoader):
        def compose_mapping_node(self, anchor: Any) -> Any:
            node, keys = super().compose_mapping_node(anchor), set()
            for key in (key for key, _ in node.value if isinstance(key, yaml.ScalarNode)):
                if (key.tag, key.value) in keys:
                    told = f"{shown(key.value)} twice in a mapping (keep one)"
                    raise yaml.MarkedYAMLError(problem=told, problem_mark=key.start_mark)
                keys.add((key.tag, key.value))
            return node

    return Loader


def read_json(path: Path) -> Dict[str, Any]:
    """The object in a JSON file; ConfigError if it is absent, or none."""
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError(f"{path}: expected figures, got: {error.strerror}") from error
    except (ValueError, RecursionError) as error:
        raise ConfigError(f"{path}: expected figures in JSON, got: {error}") from error
    if not isinstance(found, dict):
        raise ConfigError(f"{path}: expected an object of figures, got {type(found).__name__}")
    return found


def _convert(kind: Any, value: Any, label: str) -> Any:
    origin, members = typing.get_origin(kind), typing.get_args(kind)
    if origin is Union or type(kind).__name__ == "UnionType":  # the latter: A | B, Python 3.10
        return _convert_union(members, value, label)
    if isinstance(kind, type) and dataclasses.is_dataclass(kind):
        return from_plain(kind, value, label)
    if origin in (tuple, list):
        every = origin is list or members[1:] == (Ellipsis,)
        return _convert_sequence(members[0] if every else members, value, label)
    if origin is typing.Literal:
        if value not in members:
            valid = nearest(str(value)[:80], members)
            raise ConfigError(f"{label}: unknown {shown(value)}; {valid}")
        return value
    if kind is bytes and isinstance(value, str):
        with contextlib.suppress(ValueError):
            return base64.b64decode(value, validate=True)
    number = kind is float and isinstance(value, (int, float)) and not isinstance(value, bool)
    if number and abs(value) <= sys.float_info.max:  # nor NaN
        return float(value)
    plain = kind in (int, bool, str) and isinstance(value, kind)
    if kind is Any or (plain and isinstance(value, bool) == (kind is bool)):
        return value
    name = getattr(kind, "__name__", str(kind))
    raise ConfigError(f"{label}: expected {name}, got {shown(value)} ({type(value).__name__})")


def _convert_union(members: Tuple[Any, ...], value: Any, label: str) -> Any:
    if value is None and type(None) in members:
        return None
    problems = []
    for member in (member for member in members if member is not type(None)):
        try:
            return _convert(member, value, label)
        except ConfigError as error:
            problems.append(str(error))
    raise ConfigError("; or ".join(problems))


def _convert_sequence(members: Any, value: Any, label: str) -> Tuple[Any, ...]:
    """``members`` is a tuple of as many kinds, or the kind of all."""
    if not isinstance(value, (list, tuple)):
        raise ConfigError(f"{label}: expected a list, got {shown(value)}")
    kinds = members if isinstance(members, tuple) else (members,) * len(value)
    if len(kinds) != len(value):
        got = f"{len(value)}: {shown(value)}"
        raise ConfigError(f"{label}: expected {len(kinds)} values, got {got}")
    return tuple(_convert(k, v, f"{label}[{i}]") for i, (k, v) in enumerate(zip(kinds, value)))
