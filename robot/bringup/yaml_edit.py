"""Changing values in a YAML file that a person wrote: the other sections stay as they are."""

from __future__ import annotations

from functools import reduce
from pathlib import Path
from typing import Any, Dict, List, Tuple, Type, TypeVar

from robot.errors import ConfigError
from robot.output import write_text
from robot.typed_config import from_plain, read_yaml, to_plain

T = TypeVar("T")
Keys = Tuple[str, ...]


def edit_yaml(kind: Type[T], path: Path, values: Dict[Keys, Any]) -> List[str]:
    """Set values by their keys, such as ``("hat", "steps_per_rev")``.

    Each section that holds one is written anew, without its comments; the rest stays to the byte.
    The file is replaced whole or not at all, and only by one that ``kind`` accepts and whose data
    differ in these values alone. Returns a line for each value that changed, from the default where
    the file said nothing. ConfigError: the file does not fit ``kind`` before, or afterwards.
    """
    import yaml

    before = from_plain(kind, read_yaml(path), where=str(path))
    wanted, text = to_plain(read_yaml(path)), path.read_text(encoding="utf-8")
    for keys, value in values.items():
        section = wanted
        for key in keys[:-1]:
            section[key] = dict(section.get(key) or {})  # not what an alias shares
            section = section[key]
        section[keys[-1]] = to_plain(value)
    after = from_plain(kind, wanted, where=str(path))
    for name in dict.fromkeys(keys[0] for keys in values):
        text = _with_section(text, name, wanted[name])
    try:
        found = yaml.safe_load(text)
    except yaml.YAMLError:
        found = None
    if found != wanted:
        lines = ", ".join(f"{'.'.join(keys)}: {value}" for keys, value in values.items())
        raise ConfigError(f"{path}: its layout is beyond me; write there yourself: {lines}")
    write_text(path, text)
    changes = [(keys, _at(before, keys), _at(after, keys)) for keys in values]
    told = [(".".join(keys), _shown(old), _shown(new)) for keys, old, new in changes if old != new]
    return [f"{name}: {old} -> {new}" for name, old, new in told]


def _with_section(text: str, name: str, content: Any) -> str:
    import yaml

    written = yaml.safe_dump({name: content}, default_flow_style=None, sort_keys=False, width=100)
    lines = text.splitlines(keepends=True)
    first = next((i for i, line in enumerate(lines) if line.startswith(f"{name}:")), len(lines))
    last = first + 1  # the line that begins at the margin again, less empty ones before it
    while last < len(lines) and (not lines[last].strip() or lines[last][0] in " \t"):
        last += 1
    while last > first + 1 and not lines[last - 1].strip():
        last -= 1
    above = "".join(lines[:first])
    return above + ("\n" if above[-1:].strip() else "") + written + "".join(lines[last:])


def _at(config: Any, keys: Keys) -> Any:
    return reduce(lambda part, key: getattr(part, key, None), keys, config)


def _shown(value: Any) -> str:
    if isinstance(value, tuple):
        return f"[{', '.join(map(_shown, value))}]"
    return f"{value:.6g}" if isinstance(value, float) else "none" if value is None else str(value)
