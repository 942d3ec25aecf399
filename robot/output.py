"""Files that are there whole or not at all; and whether they can be written, before the work."""

import json
import math
import os
import shutil
import tempfile
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Iterable, Iterator, Optional

from robot.errors import ConfigError
from robot.typed_config import to_plain


def write_json(path: Path, data: Any) -> None:
    """Write a dataclass or plain data, NaN as null; ConfigError where there is no place for it."""
    write_text(path, json.dumps(_without_nan(to_plain(data)), indent=1) + "\n")


def _without_nan(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _without_nan(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_without_nan(item) for item in value]
    return None if isinstance(value, float) and math.isnan(value) else value


def write_yaml(path: Path, data: Any) -> None:
    """Write a dataclass or plain data, which ``robot.typed_config.load_yaml`` reads."""
    import yaml

    write_text(path, yaml.safe_dump(to_plain(data), sort_keys=False))


def write_text(path: Path, text: str) -> None:
    """As ``write_bytes``, in UTF-8."""
    write_bytes(path, text.encode("utf-8"))


def write_bytes(path: Path, data: bytes) -> None:
    """Write beside, then rename: a reader never sees half a file; ConfigError without a place."""
    try:
        with atomically(path) as temporary:
            temporary.write_bytes(data)
    except OSError as error:
        raise _no_place(path, error) from error


@contextmanager
def atomically(path: Path) -> Iterator[Path]:
    """A temporary path beside ``path`` that takes its place once the block has succeeded.

    What a link points to is replaced, not the link. A device or a pipe is written to as it is:
    a file in its place would be no device any more.
    """
    if path.exists() and not path.is_file() and not path.is_dir():
        yield path
        return
    target = Path(os.path.realpath(path))
    target.parent.mkdir(parents=True, exist_ok=True)
    temporary = target.with_name(f".{target.name[:200]}.{os.getpid()}.tmp")
    try:
        yield temporary
        with temporary.open("rb") as file:  # else a power cut after the renaming leaves no data
            os.fsync(file.fileno())
        with suppress(OSError):  # who may read it still may; FAT keeps no modes
            shutil.copymode(str(target), str(temporary))
            os.chown(temporary, target.stat().st_uid, target.stat().st_gid)
        os.replace(temporary, target)
    finally:
        if temporary.exists():
            temporary.unlink()


def expect_writable(*paths: Optional[Path], inputs: Iterable[Optional[Path]] = ()) -> None:
    """Make sure, before the work, that these files can be written after it; nothing is left.

    ConfigError: a folder has the name, two have the same, one is among the ``inputs`` that are
    read, or its folder takes no files.
    """
    taken = {os.path.realpath(path): "what is read" for path in inputs if path is not None}
    for path in paths:
        if path is None or (path.exists() and not path.is_file() and not path.is_dir()):
            continue
        if path.is_dir():
            raise ConfigError(f"{path}: expected a file to write to, got a folder; add a name")
        real = os.path.realpath(path)
        if real in taken:
            raise ConfigError(f"{path}: expected a file of its own to write to, got {taken[real]}")
        taken[real] = "another output"
        expect_folder(Path(real).parent, path)


def expect_folder(folder: Path, whose: Optional[Path] = None) -> None:
    """ConfigError, telling of ``whose`` file, unless a folder can be made and takes files."""
    found = folder
    try:
        while not found.exists() and found != found.parent:
            found = found.parent
        with tempfile.NamedTemporaryFile(dir=str(found), prefix=".duckpilot-"):
            pass
    except OSError as error:
        raise _no_place(whose or folder, error) from error


def _no_place(path: Path, error: OSError) -> ConfigError:
    return ConfigError(f"{path}: expected a place to write to, got: {error.strerror}")
