"""Table 1 of paper B: who foretells what a person did on a recorded drive.

The supervised network is of the policy's architecture, taught with what the person did.
"""

import hashlib
import re
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import torch
from gymnasium import spaces
from matplotlib.figure import Figure
from rich.console import Console
from rich.table import Table as RichTable
from torch import nn
from torch.nn import functional

from robot.errors import ConfigError
from robot.inference.preprocess import preprocess_batch
from trainer.experiments import records
from trainer.experiments.cli import Table1Options
from trainer.judging.intervals import bootstrap
from trainer.learners.networks import DrivingFeatures
from trainer.presets import preset
from trainer.relit import relit
from trainer.report.curves import save_figure
from trainer.resumable import fit
from trainer.transfer.networks import through

BATCH = 32
LEARNING_RATE = 1e-3
WEIGHT_DECAY = 1e-3
MIRRORED = np.array([records.Turn.RIGHT, records.Turn.STRAIGHT, records.Turn.LEFT])
_AT_ONCE = 256


def turn_network(height: int, width: int) -> nn.Sequential:
    """Convolutions and widths of the policies of the task ``track``, for pictures of this size.

    Stacks (N, H, W, 3 * STACK) uint8 -> logits of `Turn`.
    """
    net = preset("track", "ppo", "fast").net
    return nn.Sequential(
        DrivingFeatures(spaces.Box(0, 255, (height, width, 3 * records.STACK), np.uint8), net),
        nn.Dropout(),
        nn.Linear(net.image_fc, net.head_fc),
        nn.ReLU(),
        nn.Dropout(),
        nn.Linear(net.head_fc, len(records.Turn)),
    )


def teach_turns(
    training: records.Stacks, steps: int, seed: int, checkpoint: Path, console: Console
) -> nn.Module:
    """Train on what the person did, from ``checkpoint`` on: relit, half of it in the mirror."""
    torch.manual_seed(seed)
    network = turn_network(*training.pictures.shape[1:3])
    optimiser = torch.optim.AdamW(network.parameters(), LEARNING_RATE, weight_decay=WEIGHT_DECAY)

    def loss_of(rng: np.random.Generator) -> torch.Tensor:
        chosen = rng.integers(len(training.last), size=BATCH)
        stacks, wanted = training.stacked(chosen), training.turns[chosen]
        for i in range(BATCH):
            stacks[i] = relit(stacks[i], rng)
            if rng.random() < 0.5:
                stacks[i], wanted[i] = stacks[i][:, ::-1].copy(), MIRRORED[wanted[i]]
        return functional.cross_entropy(network(torch.from_numpy(stacks)), torch.from_numpy(wanted))

    fit(network, optimiser, loss_of, checkpoint, steps, seed, checkpoint.stem, console)
    return network


# Paper B, Table 1, on Sully Chen's frames.
PAPER = {"ours": 0.4340, "b-rl": 0.2833, "supervised": 0.5360}
BLOCK_FRAMES = 20  # neighbours are alike: whole stretches are drawn together
DECISION_S = 0.1  # between a policy's pictures


@dataclass(frozen=True)
class Accuracy:
    """One driver on the test frames."""

    driver: str
    seed: int
    accuracy: float
    low: float  # 95 % interval: of this drive; another day on another track is another draw
    high: float
    balanced: float  # mean of the recalls of the turns that occur


@dataclass(frozen=True)
class Table:
    """``table1.json``."""

    data: str
    training_frames: int
    test_frames: int
    training_shares: list[float]  # of left, straight and right
    shares: list[float]  # likewise, of the test frames
    rows: tuple[Accuracy, ...]


def foretell(out: Path, options: Table1Options, console: Console) -> Table:
    """Everyone's accuracy on the test part of a drive; supervised networks are kept in ``out``.

    DuckpilotError if the drive cannot be read, or is none to learn or to test on, or a policy is
    none to ask; then nothing is written.
    """
    policies, drive = records.named_policies(options.policy), records.load_drive(options.data)
    if drive.skipped:
        console.print(f"{options.data}: skipped {drive.skipped} broken records", markup=False)
    every = max(1, round(DECISION_S * options.rate_hz))
    halves = partial(records.split_by_time, drive, records.frames_of(drive), every)
    usual = partial(preprocess_batch, spec=preset("track", "ppo", "fast").image)
    training, test = halves(usual)
    for part, name in ((training, "first 60 %"), (test, "rest")):
        _refuse_one_turn(part, name, drive)
    rows = chance(test.turns, int(np.bincount(training.turns).argmax()))
    kinds: dict[str, tuple[str, records.See]] = {"": ("supervised", usual)}  # by translator
    for name, seed, policy in policies:
        seen = halves(policy.see)[1]
        rows.append(compare(name, seed, seen.turns, policy.turns(seen.stacked())))
        kinds.setdefault(policy.translator, (f"supervised, as {name} sees", policy.see))
    out.mkdir(parents=True, exist_ok=True)
    for kind, see in kinds.values():
        part, rest = halves(see)
        known = hashlib.sha256(b"".join(each.tobytes() for each in (*part[:3], np.array(every))))
        for seed in range(options.seeds):
            stem = re.sub(r"[^A-Za-z0-9]+", "_", kind)
            kept = out / f"{stem}_{seed}_{options.steps}_{known.hexdigest()[:8]}.pt"
            network = teach_turns(part, options.steps, seed, kept, console)
            logits = through(network, rest.stacked(), size=_AT_ONCE)
            rows.append(compare(kind, seed, rest.turns, logits.argmax(1)))
    counts = [np.bincount(part.turns, minlength=len(records.Turn)) for part in (training, test)]
    taught, asked = ((count / count.sum()).tolist() for count in counts)
    return Table(str(options.data), len(training.last), len(test.last), taught, asked, tuple(rows))


def _refuse_one_turn(part: records.Stacks, name: str, drive: records.Drive) -> None:
    done = {records.Turn(turn).name.lower() for turn in part.turns.tolist()}
    if len(done) < 2:
        raise ConfigError(
            f"drive: expected turns of two kinds at least in its {name}, got only {done.pop()}; "
            f"the angles go from {drive.steering_deg.min():.3g} to {drive.steering_deg.max():.3g} "
            "degrees: another part of the drive, or other units?"
        )


def compare(driver: str, seed: int, wanted: np.ndarray, guessed: np.ndarray) -> Accuracy:
    """How far guesses (N,) agree with what the person did (N,), values of `Turn`."""
    right = wanted == guessed
    recalls = [right[wanted == turn].mean() for turn in np.unique(wanted)]
    figures = (right.mean(), *bootstrap(right, np.mean, BLOCK_FRAMES), np.mean(recalls))
    return Accuracy(driver, seed, *map(float, figures))


def chance(wanted: np.ndarray, common: int) -> list[Accuracy]:
    """Who needs no picture: drawing among three, always the training's commonest turn, the test's.

    ``wanted`` are (N,) values of `Turn` of the test.
    """
    drawn = np.random.default_rng(0).integers(len(records.Turn), size=len(wanted))
    often = int(np.bincount(wanted, minlength=len(records.Turn)).argmax())
    always = [
        compare(f"always {records.Turn(turn).name.lower()}", 0, wanted, np.full(len(wanted), turn))
        for turn in dict.fromkeys((common, often))
    ]
    return [compare("drawn by lot", 0, wanted, drawn), *always]


def draw_table(table: Table, path: Path) -> None:
    """Bars of each driver's accuracy with every seed's interval, the paper's figures beside."""
    drivers: dict[str, list[Accuracy]] = {}
    for row in table.rows:
        drivers.setdefault(row.driver, []).append(row)
    figure = Figure(figsize=(8.0, 1.2 + 0.42 * len(drivers)), layout="constrained")
    axis = figure.subplots()
    places = np.arange(len(drivers))
    means = [np.mean([row.accuracy for row in rows]) for rows in drivers.values()]
    axis.barh(places - 0.17, means, 0.32, color="steelblue", label="here")
    paper = [PAPER.get(driver, 0.0) for driver in drivers]
    axis.barh(places + 0.17, paper, 0.32, color="lightgrey", label="paper B, other data")
    for place, rows in zip(places, drivers.values(), strict=True):
        for k, row in enumerate(rows):
            at = place - 0.17 + 0.08 * (k - (len(rows) - 1) / 2)
            axis.plot((row.low, row.high), (at, at), color="black", linewidth=1)
            axis.plot(row.accuracy, at, "o", color="black", markersize=3)
    axis.set_yticks(places, list(drivers))
    axis.invert_yaxis()
    axis.set(xlim=(0, 1), xlabel=f"share of turns predicted, {table.test_frames} test frames")
    figure.legend(loc="outside lower right", ncols=2, frameon=False, fontsize="small")
    save_figure(figure, path)


def as_table(table: Table) -> RichTable:
    """For the terminal."""
    left, straight, right = table.shares
    title = (
        f"{table.test_frames} test frames: {left:.0%} left, {straight:.0%} straight, "
        f"{right:.0%} right"
    )
    columns = ("driver", "seed", "accuracy", "95 % interval", "mean of recalls", "paper B")
    shown = RichTable(*columns, title=title)
    for row in table.rows:
        paper = f"{PAPER[row.driver]:.1%}" if row.driver in PAPER else ""
        figures = f"{row.accuracy:.1%}", f"{row.low:.1%} to {row.high:.1%}", f"{row.balanced:.1%}"
        shown.add_row(row.driver, str(row.seed), *figures, paper)
    return shown
