"""The files of a translation run, each written whole or not at all."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import torch

from robot.errors import ConfigError
from trainer.run import CONFIG, atomically, begin_run, read_run
from trainer.torch_file import load_torch
from trainer.translation.config import TranslationConfig


class TranslationFolder:
    """The paths of a run, and how each is written."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.config = path / CONFIG
        self.checkpoint = path / "checkpoint.pt"
        self.tensorboard = path / "tensorboard"

    def onnx(self, direction: str) -> Path:
        """The translator in this direction, see `robot.inference.translator.DIRECTIONS`."""
        return self.path / f"{direction.replace('-', '_')}.onnx"

    def create(self, config: TranslationConfig) -> None:
        """Begin a run here; ConfigError if one lies here."""
        begin_run(self.path, config)

    def load_config(self) -> TranslationConfig:
        """The configuration that this run was begun with; ConfigError if there is none."""
        return read_run(TranslationConfig, self.path)

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
        remedy = "; put a copy of it back, or delete it and train from the beginning"
        state: dict[str, Any] = load_torch(
            self.checkpoint, "the checkpoint of this run", device, remedy
        )
        return state
