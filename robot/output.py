"""Files that are there whole or not at all."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

from robot.errors import ConfigError

if TYPE_CHECKING:
    import numpy as np  # an installation runs before there is one


def write_json(path: Path, data: Any) -> None:
    """Write JSON; ConfigError where the folder cannot be written."""
    write_bytes(path, (json.dumps(data, indent=1) + "\n").encode("utf-8"))


def write_png(path: Path, picture: np.ndarray) -> None:
    """Write a picture (H, W, 3) uint8 RGB as PNG; ConfigError as for ``write_json``."""
    import cv2

    write_bytes(path, cv2.imencode(".png", picture[..., ::-1])[1].tobytes())


def write_bytes(path: Path, data: bytes) -> None:
    """Write beside, then rename: a reader never sees half a file."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        temporary.write_bytes(data)
        os.replace(temporary, path)
    except OSError as error:
        raise ConfigError(f"{path}: expected a place to write to, got: {error.strerror}") from error
