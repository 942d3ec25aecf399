"""The supervised network of paper B: the policy's architecture, taught with what a person did."""

from pathlib import Path

import numpy as np
import torch
from gymnasium import spaces
from rich.console import Console
from torch import nn
from torch.nn import functional

from trainer.experiments.records import STACK, Stacks, Turn
from trainer.learners.networks import DrivingFeatures
from trainer.presets import preset
from trainer.relit import relit
from trainer.resumable import fit
from trainer.transfer.networks import through

BATCH = 32
LEARNING_RATE = 1e-3
WEIGHT_DECAY = 1e-3
MIRRORED = np.array([Turn.RIGHT, Turn.STRAIGHT, Turn.LEFT])
_AT_ONCE = 256


class TurnNetwork(nn.Module):
    """Convolutions and widths of the policies of the task ``track``: stacks -> logits of `Turn`.

    Takes (N, H, W, 3 * STACK) uint8.
    """

    def __init__(self, shape: tuple[int, int, int]) -> None:
        """``shape``: (H, W, 3) of one picture."""
        super().__init__()
        net = preset("track", "ppo", "fast").net
        height, width, colours = shape
        stacks = spaces.Box(0, 255, (height, width, colours * STACK), np.uint8)
        self.convolutions = DrivingFeatures(stacks, net)
        self.head = nn.Sequential(
            nn.Dropout(),
            nn.Linear(net.image_fc, net.head_fc),
            nn.ReLU(),
            nn.Dropout(),
            nn.Linear(net.head_fc, len(Turn)),
        )

    def forward(self, stacks: torch.Tensor) -> torch.Tensor:
        """See the class."""
        return self.head(self.convolutions(stacks))

    def turns(self, stacks: np.ndarray) -> np.ndarray:
        """(N, H, W, 3 * STACK) uint8 -> (N,) the likeliest turns."""
        return through(lambda some: self(some).argmax(1), stacks, size=_AT_ONCE)


def teach_turns(
    training: Stacks, steps: int, seed: int, checkpoint: Path, console: Console
) -> TurnNetwork:
    """Train on what the person did, from where ``checkpoint`` left off."""
    torch.manual_seed(seed)
    network = TurnNetwork(training.pictures.shape[1:])
    optimiser = torch.optim.AdamW(network.parameters(), LEARNING_RATE, weight_decay=WEIGHT_DECAY)

    def loss_of(rng: np.random.Generator) -> torch.Tensor:
        stacks, wanted = draw_stacks(training, BATCH, rng)
        return functional.cross_entropy(network(torch.from_numpy(stacks)), torch.from_numpy(wanted))

    fit(network, optimiser, loss_of, (checkpoint, steps, seed), checkpoint.stem, console)
    return network


def draw_stacks(
    training: Stacks, count: int, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """``count`` moments, relit, half of them in the mirror with their turns exchanged."""
    chosen = rng.integers(len(training.last), size=count)
    stacks, wanted = training.stacked(chosen), training.turns[chosen]
    for i in range(count):
        pictures = relit(stacks[i], rng)
        if rng.random() < 0.5:
            pictures, wanted[i] = pictures[:, ::-1], MIRRORED[wanted[i]]
        stacks[i] = pictures
    return stacks, wanted
