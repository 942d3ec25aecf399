"""``train-sight``: gather pictures, teach the network, calibrate it, write it for the robot."""

import math
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import torch
from rich.console import Console
from rich.progress import track

from robot.errors import ConfigError
from robot.navigation.road_map import load_map
from robot.output import atomically
from robot.vision.sight import SightContract
from sim_pybullet.randomise import load_look_sampler
from trainer.division import division, refuse_judging_look, refuse_judging_maps
from trainer.export import quantise
from trainer.resumable import descend, run_steps, set_rate
from trainer.run import take_up
from trainer.sight.augment import drawn
from trainer.sight.bystanders import Bystanders
from trainer.sight.cli import SightRun
from trainer.sight.network import SightNetwork, calibrate, export_sight, learned
from trainer.sight.photographs import learned_from
from trainer.sight.pictures import IMAGE, ROBOTS, START_SPREAD, Pictures, anywhere, drive, joined

DECISIONS = 200  # of each file of pictures
_RATE, _ON_RATE = 2e-3, 5e-4  # of one that begins, and of one that learns on
_PHOTOGRAPHS = 0.06  # of a step's pictures
_WARM = 300  # steps over which the rate rises
_CHECKED = 1_000  # pictures that compare ONNX with torch, and calibrate INT8


def train_sight(out: Path, run: SightRun, console: Console) -> Path:
    """Do what of a run is not done yet; ConfigError where another lies. Gives the ONNX file."""
    for look in run.look:
        refuse_judging_look(look)
    if take_up(SightRun, out, True, lambda: run) != run:
        raise ConfigError(f"{out}: expected the options of the run there; choose another --out")
    torch.manual_seed(run.seed)
    network = learned(Path(run.base)) if run.base else SightNetwork()
    photographs = learned_from(Path(run.photographs)) if run.photographs else None
    maps = division().maps
    training = gathered(out / "training", maps.training, run.look, run.files, run.seed, console)
    looks = division().looks.choosing
    chosen = gathered(
        out / "choosing", maps.choosing, looks, run.choosing_files, run.seed + 1, console
    )
    optimiser = torch.optim.AdamW(network.parameters(), _ON_RATE if run.base else _RATE)
    parts = {"network": network, "optimiser": optimiser}
    step = lesson(network, optimiser, training, run, photographs)
    run_steps(out / "checkpoint.pt", parts, run.steps, run.seed, step, "sight", console)
    calibrate(network, chosen)
    path, images = out / "sight.onnx", chosen.images[:: max(1, len(chosen.images) // _CHECKED)]
    contract = SightContract(IMAGE, run=out.name, trained_steps=run.steps)
    export_sight(network, contract, images, path)
    quantise(path, {"image": images}, out / "sight_int8.onnx")
    return path


def gathered(
    folder: Path,
    names: Sequence[str],
    looks: Sequence[str],
    files: int,
    seed: int,
    console: Console,
) -> Pictures:
    """Pictures of robots on these maps, from files that are there or are made now."""
    maps = [load_map(name) for name in names]
    refuse_judging_maps(maps)
    folder.mkdir(parents=True, exist_ok=True)
    found = []
    for number in track(range(files), f"{folder.name} pictures", console=console):
        path = folder / f"{number:03d}.npz"
        if not path.exists():
            look, own = load_look_sampler(looks[number % len(looks)]), seed * 1_000 + number
            task = Bystanders(maps, ROBOTS, START_SPREAD, own)
            driven = drive(task, look, own, DECISIONS)
            made = joined([driven, anywhere(maps, look, own)])
            with atomically(path) as temporary, temporary.open("wb") as file:
                np.savez(file, **made._asdict())
        with np.load(path) as parts:
            found.append(Pictures(**parts))
    return joined(found)


def lesson(
    network: SightNetwork,
    optimiser: torch.optim.Optimizer,
    pictures: Pictures,
    run: SightRun,
    photographs: Pictures | None,
) -> Callable[[np.random.Generator, int], str]:
    """One step of the training, for `trainer.resumable.run_steps`."""
    count = round(_PHOTOGRAPHS * run.batch) if photographs else 0

    def step(rng: np.random.Generator, number: int) -> str:
        rate = optimiser.defaults["lr"] * 0.5 * (1.0 + math.cos(math.pi * number / run.steps))
        set_rate([optimiser], rate * min(1.0, (number + 1) / _WARM))
        parts = [drawn(pictures, run.batch - count, rng)]
        if photographs:
            parts.append(drawn(photographs, count, rng, moved=True))
        images, labels = joined(parts)
        loss = network.loss(torch.from_numpy(images), torch.from_numpy(labels))
        return f"loss {descend(optimiser, loss):.3f}"

    return step
