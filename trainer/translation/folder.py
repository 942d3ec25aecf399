"""The files of a translation run, each written whole or not at all."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import torch
import yaml

from robot.errors import ConfigError
from robot.typed_config import load_yaml, to_plain
from trainer.run import atomically
from trainer.translation.config import TranslationConfig


class TranslationFolder:
    """The paths of a run, and how each is written."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.config = path / "config.yaml"
        self.checkpoint = path / "checkpoint.pt"
        self.tensorboard = path / "tensorboard"

    def onnx(self, direction: str) -> Path:
        """The translator in this direction, see `robot.inference.translator.DIRECTIONS`."""
        return self.path / f"{direction.replace('-', '_')}.onnx"

    def create(self, config: TranslationConfig) -> None:
        """Begin a run here.

        Raises:
            ConfigError: a run lies here already.
        """
        if self.config.exists():
            raise ConfigError(
                f"{self.path}: expected no run here yet, got one; "
                "add --resume to go on with it, or choose another --out"
            )
        self.path.mkdir(parents=True, exist_ok=True)
        with atomically(self.config) as temporary:
            temporary.write_text(yaml.safe_dump(to_plain(config), sort_keys=False))

    def load_config(self) -> TranslationConfig:
        """The configuration that this run was begun with.

        Raises:
            ConfigError: no run lies here.
        """
        if not self.config.exists():
            raise ConfigError(f"{self.path}: expected the folder of a run, found no config.yaml")
        return load_yaml(TranslationConfig, self.config)

    def save(self, state: dict[str, Any]) -> None:
        """Write the checkpoint."""
        with atomically(self.checkpoint) as temporary:
            torch.save(state, temporary)

    def load(self, device: torch.device) -> dict[str, Any]:
        """The checkpoint.

        Raises:
            ConfigError: there is none yet.
        """
        if not self.checkpoint.exists():
            raise ConfigError(f"{self.path}: expected a checkpoint, found none; train first")
        state: dict[str, Any] = torch.load(self.checkpoint, map_location=device, weights_only=True)
        return state
