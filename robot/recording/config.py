"""What a robot's YAML file says about recording."""

from __future__ import annotations

import math
from dataclasses import dataclass

from robot.errors import ConfigError


@dataclass(frozen=True)
class RecordingConfig:
    """Where drives are recorded, and how much of the disk they leave alone.

    Raises:
        ConfigError: no folder, or a negative size.
    """

    folder: str
    keep_free_mb: float = 500.0  # the system needs room for its own logs and updates

    def __post_init__(self) -> None:
        if not self.folder:
            raise ConfigError(
                "recording.folder: expected a folder, got ''; to record nothing, leave the "
                "recording section out"
            )
        if not 0.0 <= self.keep_free_mb < math.inf:
            raise ConfigError(
                f"recording.keep_free_mb: expected 0 or more, got {self.keep_free_mb}"
            )
