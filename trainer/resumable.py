"""A training loop that may be killed at any moment and goes on as if it had not been.

What happens in step k depends on the seed and k alone: a resumed run is the same as another.
"""

import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from math import inf
from pathlib import Path
from typing import Any

import numpy as np
import torch
from rich.console import Console
from rich.progress import MofNCompleteColumn, Progress, TextColumn
from torch.nn.utils import clip_grad_norm_

from trainer.torch_file import loaded, save_torch

SAVE_EVERY_S = 20.0
_REMEDY = "; put a copy of it back, or delete it and begin again"


@dataclass(frozen=True)
class Loop:
    """Runs ``steps`` steps, keeping ``parts`` in the file ``path``."""

    path: Path
    parts: Mapping[str, Any]  # networks, optimisers: with state_dict and load_state_dict
    steps: int
    seed: int

    def done(self) -> int:
        """Load the file, if there is one; how many steps were done when it was written."""
        if not self.path.exists():
            return 0
        with loaded(self.path, "the checkpoint of this run", remedy=_REMEDY) as content:
            for name, part in self.parts.items():
                part.load_state_dict(content["parts"][name])
            return int(content["step"])

    def _save(self, step: int) -> None:
        parts = {name: part.state_dict() for name, part in self.parts.items()}
        save_torch(self.path, {"step": step, "parts": parts})

    def run(
        self, step: Callable[[np.random.Generator, int], str], name: str, console: Console
    ) -> None:
        """Call ``step(rng, k)`` for each step not done yet; what it returns stands beside the bar.

        Whoever stops it loses at most `SAVE_EVERY_S` of work.
        """
        torch.set_num_threads(1)  # with a second one networks as small as ours are slower
        first, saved = self.done(), time.monotonic()
        columns = (*Progress.get_default_columns(), MofNCompleteColumn())
        with Progress(*columns, TextColumn("{task.fields[note]}"), console=console) as bar:
            row = bar.add_task(name, total=self.steps, completed=first, note="")
            for k in range(first, self.steps):
                rng = np.random.default_rng((self.seed, k))
                torch.manual_seed(int(rng.integers(2**31)))  # dropout's
                bar.update(row, note=step(rng, k), advance=1)
                if time.monotonic() - saved > SAVE_EVERY_S:
                    self._save(k + 1)
                    saved = time.monotonic()
        if first < self.steps:
            self._save(self.steps)


def fit(
    network: torch.nn.Module,
    optimiser: torch.optim.Optimizer,
    loss_of: Callable[[np.random.Generator], torch.Tensor],
    loop: tuple[Path, int, int],
    name: str,
    console: Console,
) -> None:
    """Train a network until its steps are done; it ends in evaluation mode.

    ``loop``: checkpoint to go on from, steps, seed. The rate falls to nothing along a cosine.
    """
    path, steps, seed = loop
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, steps)
    parts = {"network": network, "optimiser": optimiser, "schedule": schedule}

    def step(rng: np.random.Generator, _: int) -> str:
        loss = descend(optimiser, loss_of(rng))
        schedule.step()
        return f"loss {loss:.3f}"

    network.train()
    Loop(path, parts, steps, seed).run(step, name, console)
    network.eval()


def descend(optimiser: torch.optim.Optimizer, loss: torch.Tensor, most: float = inf) -> float:
    """One step of an optimiser down this loss, by a gradient of at most this norm; the loss."""
    optimiser.zero_grad()
    loss.backward()
    if most < inf:
        clip_grad_norm_((p for group in optimiser.param_groups for p in group["params"]), most)
    optimiser.step()
    return loss.item()


def set_rate(optimisers: Iterable[torch.optim.Optimizer], rate: float) -> None:
    """What they learn by from now on."""
    for group in (group for optimiser in optimisers for group in optimiser.param_groups):
        group["lr"] = rate
