"""A parser as a translator: pictures become the classes that it sees, painted.

A policy that learned from such pictures drives on what is the same in simulation and in reality;
what the parser gets wrong, it gets wrong in both. It needs the parser wherever it goes.
"""

from __future__ import annotations

from pathlib import Path

import torch
from torch import nn

from robot.contract import ImageSpec
from robot.inference.translator import PARSING, TranslatorContract
from trainer.parsing.through_parsing import painted
from trainer.parsing.train import Parser
from trainer.translation.export import export_translator


class ParsedPictures(nn.Module):
    """(N, H, W, 3) uint8 RGB -> the same, each pixel its class's colour; what is exported."""

    favours: torch.Tensor  # (C, 1, 1) to be taken off the logits
    colours: torch.Tensor  # (C, 3)

    def __init__(self, parser: Parser) -> None:
        super().__init__()
        self.network = parser.network
        self.register_buffer("favours", parser.favours)
        self.register_buffer("colours", torch.tensor(parser.labels.colours, dtype=torch.float32))

    def forward(self, image: torch.Tensor) -> torch.Tensor:
        """See the class."""
        seen = painted(self.network(image) - self.favours, self.colours)
        return seen.to(torch.uint8).permute(0, 2, 3, 1)


def export_parser(parser: Parser, name: str, path: Path) -> None:
    """Write the parser as an ONNX translator of whole frames at its own size.

    Raises:
        ContractError: torch and ONNX disagree.
    """
    config = parser.config
    image = ImageSpec(config.width_px, config.height_px)
    contract = TranslatorContract(
        "segnet", PARSING, image, name, config.steps, notes=(f"labels {config.labels}",)
    )
    export_translator(ParsedPictures(parser), contract, path)
