"""``python -m tests.trainer.judge_parsing RUN --sim COLLECTION``: where lines are lost in parsing.

Told by brightness, as ``trainer translate judge`` tells them. First what paint itself would keep,
were it where the simulator has it: what is bright in a simulated picture is not all paint, and worn
or shaded paint is not bright. Then what true classes keep, those that the first network finds,
true ones through the second network, and both networks.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
import torch
from torch import nn

from robot.command_line import OneLineParser, answer
from trainer.learners.backbone import centred
from trainer.presets import preset
from trainer.torch_file import loaded
from trainer.transfer.judge import lanes_kept
from trainer.transfer.labelled import ROAD
from trainer.transfer.networks import as_bytes, through
from trainer.transfer.pictures import load_paint, load_pictures
from trainer.transfer.pix2pix import PIX2PIX, Pix2Pix, ThroughParsing, simulated_pairs

DARK, LIGHT = 60, 240  # road and paint [grey levels]
LINES = tuple(ROAD.classes.index(name) for name in ("white_line", "yellow_line"))


def half(path: Path) -> nn.Module:
    """A network of a run with the small networks; ConfigError where there is none."""
    model = Pix2Pix(PIX2PIX["small"], 0)
    with loaded(path, "a half of a translation through parsing") as content:
        model.generator.load_state_dict(content["parts"]["generator"])
    return model.generator.eval()


def drawn(shares: np.ndarray) -> np.ndarray:
    """Pictures (N, H, W, 3) uint8 of shares of paint (N, H, W) from 0 to 1."""
    grey = DARK + (LIGHT - DARK) * shares
    return grey[..., None].repeat(3, axis=3).astype(np.uint8)


def kept(run: Path, collection: Path) -> dict[str, float]:
    """Shares of the lines that are kept, stage by stage."""
    image = preset("lane", "dueling", "fast").image
    simulated = load_pictures([collection], image)
    paint, true = load_paint(simulated, image), simulated_pairs(str(collection), image, ROAD).wanted
    network = ThroughParsing(
        *(half(run / f"{n}.pt") for n in ("virtual_to_parsing", "parsing_to_real"))
    )
    with torch.no_grad():
        found = through(lambda some: as_bytes(network.parsed(some)), simulated.images)
        second = through(lambda some: as_bytes(network.to_real(centred(some))), true)
        both = through(network, simulated.images)
    made = {
        "paint": drawn(paint[:, :2].sum(1, dtype=float).clip(0.0, 255.0) / 255.0),
        "true classes": drawn(np.isin(ROAD.read(true), LINES)),
        "classes found": drawn(np.isin(ROAD.read(found), LINES)),
        "true classes, translated": second,
        "translation": both,
    }
    images, folder = simulated.images, simulated.folder
    return {name: lanes_kept(images, folder, paint, each) for name, each in made.items()}


def tell(options: argparse.Namespace) -> None:
    """A line for each stage."""
    for name, share in kept(options.run, options.sim).items():
        print(f"{name}: {share:.3f}")


def main() -> int:
    """Exit status 2 for wrong input."""
    parser = OneLineParser(prog="python -m tests.trainer.judge_parsing", description=__doc__)
    parser.add_argument("run", type=Path, help="folder of trainer parse translate --net small")
    parser.add_argument("--sim", type=Path, required=True, help="a collection")
    options = parser.parse_args()
    return answer("judge_parsing", lambda: tell(options))


if __name__ == "__main__":
    sys.exit(main())
