"""A training loop that may be killed at any moment and goes on as if it had not been.

What happens in step k depends on the seed and k alone: a resumed run is the same as another.
"""

import time
from collections.abc import Callable, Iterable, Mapping
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


def run_steps(
    path: Path,
    parts: Mapping[str, Any],
    steps: int,
    seed: int,
    step: Callable[[np.random.Generator, int], str],
    name: str,
    console: Console,
    threads: int = 1,
) -> None:
    """Call ``step(rng, k)`` for each step not done yet; what it returns stands beside the bar.

    ``parts``, networks and optimisers, have state_dict and load_state_dict; they are kept in the
    file ``path``. Whoever stops it loses at most `SAVE_EVERY_S` of work.
    """
    torch.set_num_threads(threads)  # small networks, or few pictures, are slower with a second one
    first, saved = 0, time.monotonic()
    if path.exists():
        with loaded(path, "the checkpoint of this run", remedy=_REMEDY) as content:
            for key, part in parts.items():
                part.load_state_dict(content["parts"][key])
            first = int(content["step"])
    columns = (*Progress.get_default_columns(), MofNCompleteColumn())
    with Progress(*columns, TextColumn("{task.fields[note]}"), console=console) as bar:
        row = bar.add_task(name, total=steps, completed=first, note="")
        for k in range(first, steps):
            rng = np.random.default_rng((seed, k))
            torch.manual_seed(int(rng.integers(2**31)))  # dropout's
            bar.update(row, note=step(rng, k), advance=1)
            if k + 1 == steps or time.monotonic() - saved > SAVE_EVERY_S:
                states = {key: part.state_dict() for key, part in parts.items()}
                save_torch(path, {"step": k + 1, "parts": states})
                saved = time.monotonic()


def fit(
    network: torch.nn.Module,
    optimiser: torch.optim.Optimizer,
    loss_of: Callable[[np.random.Generator], torch.Tensor],
    checkpoint: Path,
    steps: int,
    seed: int,
    name: str,
    console: Console,
) -> None:
    """Train a network until its steps are done, the rate falling to nothing along a cosine.

    It goes on from ``checkpoint``, and ends in evaluation mode.
    """
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, steps)
    parts = {"network": network, "optimiser": optimiser, "schedule": schedule}

    def step(rng: np.random.Generator, _: int) -> str:
        loss = descend(optimiser, loss_of(rng))
        schedule.step()
        return f"loss {loss:.3f}"

    network.train()
    run_steps(checkpoint, parts, steps, seed, step, name, console)
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
