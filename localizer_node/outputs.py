"""What the commands write."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path
from typing import Any, Dict

import numpy as np

from robot.errors import ConfigError

SCHEMA = 1


def write_json(target: str, plain: Dict[str, Any]) -> None:
    """JSON to a file, whole or not at all, or to standard output for ``-``."""
    text = json.dumps(plain, indent=1) + "\n"
    if target == "-":
        sys.stdout.write(text)
        return
    partial = Path(target + ".part")
    partial.write_text(text, encoding="utf-8")
    os.replace(partial, target)


def write_picture(path: str, picture: np.ndarray) -> None:
    """An RGB picture to a file; ConfigError where that cannot be."""
    import cv2

    if not cv2.imwrite(path, cv2.cvtColor(picture, cv2.COLOR_RGB2BGR)):
        raise ConfigError(f"{path}: expected a picture name in an existing folder (.png)")
