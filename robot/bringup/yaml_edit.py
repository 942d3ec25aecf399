"""Changing single values of a YAML file that a person wrote: comments, order and layout stay."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any, Dict, List, NamedTuple, Sequence, Tuple, Type, TypeVar

from robot.errors import ConfigError
from robot.output import write_bytes
from robot.typed_config import from_plain, read_yaml, to_plain

T = TypeVar("T")
Keys = Tuple[str, ...]


class Edit(NamedTuple):
    """One value that changed, for a person to see."""

    key: str
    old: Any
    new: Any

    def __str__(self) -> str:
        return f"{self.key}: {_shown(self.old)} -> {_shown(self.new)}"


def edit_yaml(kind: Type[T], path: Path, values: Dict[Keys, Any]) -> List[Edit]:
    """Set values by their keys, such as ``("hat", "steps_per_rev")``; the rest stays as it is.

    The file is replaced whole or not at all, and only by one that ``kind`` accepts and whose data
    differ in these values alone.

    Returns:
        What changed; where the file said nothing, from the default.

    Raises:
        ConfigError: the file does not fit ``kind`` before, or would not afterwards.
    """
    before = from_plain(kind, read_yaml(path), where=str(path))
    text = path.read_text(encoding="utf-8")
    expected = copy.deepcopy(read_yaml(path))
    for keys, value in values.items():
        text = set_value(text, keys, value)
        _put(expected, keys, value)
    if _read(text) != expected:
        lines = ", ".join(f"{'.'.join(keys)}: {_dump(value)}" for keys, value in values.items())
        raise ConfigError(f"{path}: its layout is beyond me; write there yourself: {lines}")
    after = from_plain(kind, expected, where=str(path))
    write_bytes(path, text.encode("utf-8"))
    old, new = to_plain(before), to_plain(after)
    edits = [Edit(".".join(keys), _get(old, keys), _get(new, keys)) for keys in values]
    return [edit for edit in edits if edit.old != edit.new]


def set_value(text: str, keys: Sequence[str], value: Any) -> str:
    """The YAML text with one value set, and the mappings on the way to it made."""
    import yaml

    node = yaml.compose(text, Loader=yaml.SafeLoader)
    if node is None:
        return text + _line(keys, value)
    for depth, key in enumerate(keys):
        if not isinstance(node, yaml.MappingNode):
            return _replace(text, node, _nested(keys[depth:], value))
        found = [item for name, item in node.value if name.value == key]
        if not found:
            return _insert(text, node, _line(keys[depth:], value), is_root=depth == 0)
        node = found[0]
    return _replace(text, node, _dump(value))


def _replace(text: str, node: Any, written: str) -> str:
    start, end = node.start_mark.index, node.end_mark.index
    gap = " " if start == end and text[:start].endswith(":") else ""  # there was nothing
    return text[:start] + gap + written + text[end:]


def _insert(text: str, node: Any, line: str, is_root: bool) -> str:
    start = node.start_mark.index
    if node.flow_style:
        return f"{text[: start + 1]}{line.rstrip()}{', ' if node.value else ''}{text[start + 1 :]}"
    if is_root:
        return text + ("" if text.endswith("\n") else "\n") + line
    # Where a block ends is hard to say (comments); where its first key begins is not.
    return f"{text[:start]}{line}{' ' * node.start_mark.column}{text[start:]}"


def _line(keys: Sequence[str], value: Any) -> str:
    return f"{keys[0]}: {_nested(keys[1:], value)}\n"


def _nested(keys: Sequence[str], value: Any) -> str:
    for key in reversed(keys):
        value = {key: value}
    return _dump(value)


def _dump(value: Any) -> str:
    import yaml

    dumped = yaml.safe_dump(to_plain(value), default_flow_style=True, width=10_000, sort_keys=False)
    return str(dumped).replace("\n...\n", "").strip()


def _read(text: str) -> Any:
    import yaml

    try:
        return yaml.safe_load(text)
    except yaml.YAMLError:
        return None


def _put(data: Any, keys: Keys, value: Any) -> None:
    for key in keys[:-1]:
        if not isinstance(data.get(key), dict):
            data[key] = {}
        data = data[key]
    data[keys[-1]] = to_plain(value)


def _get(data: Any, keys: Keys) -> Any:
    for key in keys:
        data = data.get(key) if isinstance(data, dict) else None
    return data


def _shown(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(_shown(item) for item in value)}]"
    return "none" if value is None else str(value)
