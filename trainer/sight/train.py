"""``train-sight``: gather pictures, teach the network, calibrate it, write it for the robot."""

import math
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
import torch
from rich.console import Console
from rich.progress import track
from torch.utils.data import DataLoader, Dataset

from robot.errors import ConfigError
from robot.navigation.road_map import load_map
from robot.output import atomically
from robot.vision.sight import OnnxSight, SightContract
from sim_pybullet.randomise import load_look_sampler
from trainer.division import division, refuse_judging_look, refuse_judging_maps
from trainer.export import quantise
from trainer.processes import shared
from trainer.resumable import descend, run_steps, set_rate
from trainer.run import take_up
from trainer.sight.augment import drawn
from trainer.sight.bystanders import Bystanders
from trainer.sight.cli import SightRun
from trainer.sight.network import SightNetwork, calibrate, export_sight, learned
from trainer.sight.photographs import learned_from
from trainer.sight.pictures import IMAGE, ROBOTS, START_SPREAD, Pictures, anywhere, drive, joined

DECISIONS = 200  # of each file of pictures
_RATE, _ON_RATE = 2e-3, 2e-4  # of one that begins, and of one that learns on
_PHOTOGRAPHS = 0.06  # of a step's pictures
_WARM = 300  # steps over which the rate rises
_CHECKED = 1_000  # pictures that compare ONNX with torch, and calibrate INT8


def train_sight(out: Path, run: SightRun, console: Console) -> Path:
    """Do what of a run is not done yet; ConfigError where another lies. Gives the ONNX file."""
    for look in run.look:
        refuse_judging_look(look)
    torch.manual_seed(run.seed)
    device = "cuda" if torch.cuda.is_available() else "cpu"
    network = (learned(Path(run.base)) if run.base else SightNetwork()).to(device)
    photographs = learned_from(Path(run.photographs)) if run.photographs else None
    if take_up(SightRun, out, True, lambda: run) != run:
        raise ConfigError(f"{out}: expected the options of the run there; choose another --out")
    maps = division().maps
    training = gathered(out / "training", maps.training, run.look, run.files, run.seed, console)
    looks = division().looks.choosing
    how = run.choosing_files, run.seed + 1, console
    chosen = gathered(out / "choosing", maps.choosing, looks, *how)
    optimiser = torch.optim.AdamW(network.parameters(), _ON_RATE if run.base else _RATE)
    parts = {"network": network, "optimiser": optimiser}
    step = lesson(network, optimiser, Batches(training, photographs, run))
    state, cores = out / "checkpoint.pt", len(os.sched_getaffinity(0))
    run_steps(state, parts, run.steps, run.seed, step, "sight", console, cores)
    calibrate(network, chosen)
    network.cpu()
    path, images = out / "sight.onnx", chosen.images[:: max(1, len(chosen.images) // _CHECKED)]
    before = OnnxSight(Path(run.base)).contract.trained_steps if run.base else 0
    contract = SightContract(IMAGE, run=out.name, trained_steps=before + run.steps)
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
    refuse_judging_maps([load_map(name) for name in names])
    folder.mkdir(parents=True, exist_ok=True)
    wanted = [
        PictureFile(folder / f"{k:03d}.npz", names, looks[k % len(looks)], seed * 1_000 + k)
        for k in range(files)
    ]
    for _ in track(shared(wanted), f"{folder.name} pictures", files, console=console):
        pass
    return joined([each.read() for each in wanted])


class PictureFile(NamedTuple):
    """Pictures of robots on some maps in a look, and the file that they are kept in."""

    path: Path
    maps: Sequence[str]
    look: str
    seed: int

    def done(self) -> bool:
        """Whether they are there."""
        return self.path.exists()

    def write(self) -> None:
        """Gather them."""
        maps, look = [load_map(name) for name in self.maps], load_look_sampler(self.look)
        task = Bystanders(maps, ROBOTS, START_SPREAD, self.seed)
        made = joined([drive(task, look, self.seed, DECISIONS), anywhere(maps, look, self.seed)])
        with atomically(self.path) as temporary, temporary.open("wb") as file:
            np.savez(file, **made._asdict())

    def read(self) -> Pictures:
        """Those that are there."""
        with np.load(self.path) as parts:
            return Pictures(**parts)


class Batches(Dataset[tuple[torch.Tensor, ...]]):
    """Pictures and labels of each step: they follow from the run's seed and the step's number."""

    def __init__(self, pictures: Pictures, photographs: Pictures | None, run: SightRun) -> None:
        self.run, self._pictures, self._photographs = run, pictures, photographs
        self._count = round(_PHOTOGRAPHS * run.batch) if photographs else 0

    def __getitem__(self, step: int) -> tuple[torch.Tensor, ...]:
        """(N, 40, 80, 3) uint8 and (N, 12)."""
        rng = np.random.default_rng((self.run.seed, step))
        parts = [drawn(self._pictures, self.run.batch - self._count, rng)]
        if self._photographs:
            parts.append(drawn(self._photographs, self._count, rng, moved=True))
        return tuple(map(torch.from_numpy, joined(parts)))

    def since(self, first: int) -> DataLoader[tuple[torch.Tensor, ...]]:
        """From this step on; the other cores draw and change the next ones meanwhile."""
        return DataLoader(
            self,
            batch_size=None,
            sampler=range(first, self.run.steps),
            num_workers=len(os.sched_getaffinity(0)) - 1,
            worker_init_fn=lambda _: cv2.setNumThreads(0),  # its threads do not outlive a fork
        )


def lesson(
    network: SightNetwork, optimiser: torch.optim.Optimizer, batches: Batches
) -> Callable[[np.random.Generator, int], str]:
    """One step of the training, for `trainer.resumable.run_steps`."""
    device, ready = network.scale.device, None

    def step(_: np.random.Generator, number: int) -> str:
        nonlocal ready
        ready = ready or iter(batches.since(number))
        cosine = math.cos(math.pi * number / batches.run.steps)
        rate = optimiser.defaults["lr"] * 0.5 * (1.0 + cosine)
        set_rate([optimiser], rate * min(1.0, (number + 1) / _WARM))
        images, labels = (each.to(device) for each in next(ready))
        return f"loss {descend(optimiser, network.loss(images, labels)):.3f}"

    return step
