"""Sight learns on in a twin, in the looks of before, and from what a recording shows.

The recorded pictures are labelled by the map, from where the fit puts the robot.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from rich.console import Console
from rich.progress import track

from robot.geometry import wrap_angle
from robot.inference.preprocess import preprocess
from robot.navigation.lane_view import LaneView
from robot.navigation.road_map import RoadMap, load_map
from robot.vision.sight import OnnxSight, SightContract
from sim_pybullet.episodes import Looks
from sim_pybullet.randomise import Sites, load_look_sampler
from trainer.division import division
from trainer.sight.bystanders import Bystanders
from trainer.sight.cli import SightRun
from trainer.sight.network import calibrate, export_sight, learned
from trainer.sight.pictures import (
    CROSSING,
    FREE,
    IMAGE,
    IN_LANE_M,
    ROBOTS,
    START_SPREAD,
    THING,
    Pictures,
    anywhere,
    drive,
    joined,
    label,
)
from trainer.sight.train import Batches, lesson
from trainer.twin.examples import HELD_OUT
from trainer.twin.fit import Twin
from trainer.twin.recorded import Recorded
from trainer.twin.teach import USUAL

DECISIONS, CHECKED = 100, 30  # of experts in each world: to learn from, and to scale by
RATE = 4e-4


class Errors(NamedTuple):
    """Root mean squares, in lanes outside junctions."""

    offset_m: float
    heading_rad: float

    def worse(self, than: "Errors") -> bool:
        """Whether it errs more, in both together."""
        return sum(ours / theirs for ours, theirs in zip(self, than, strict=True)) > len(self)


def teach_sight(
    base: Path, drives: Sequence[Recorded], twin: Twin, looks: Looks, out: Path, run: SightRun
) -> tuple[Errors, Errors]:
    """Write sight.onnx; how the base and it err in the held-out pictures of the drives.

    ``looks``: the twin's. Of ``run`` steps, batch and seed count. ContractError: no base in FP32.
    """
    network, seed, own = learned(base), run.seed, drives[0].road_map
    training = [load_map(name) for name in division().maps.training]
    usual = Sites(load_look_sampler(name) for name in USUAL)
    worlds = ([own], looks), (training, usual)
    learn, scale = (
        [_seen(*world, seed + k, decisions) for world in worlds]
        for k, decisions in enumerate((DECISIONS, CHECKED))
    )
    shown, held_out = (recorded(drives, twin, part) for part in (False, True))
    batches = Batches(joined([*learn, shown]), None, run)
    optimiser = torch.optim.AdamW(network.parameters(), RATE)
    step = lesson(network.train(), optimiser, batches)
    for number in track(range(run.steps), "teaching", console=Console(soft_wrap=True)):
        step(np.random.default_rng((seed, number)), number)
    calibrate(network, joined(scale))
    path, steps = out / "sight.onnx", OnnxSight(base).contract.trained_steps + run.steps
    contract = SightContract(IMAGE, run=out.name, trained_steps=steps)
    export_sight(network, contract, held_out.images, path)
    before, after = (errors(OnnxSight(file), held_out) for file in (base, path))
    return before, after


def _seen(maps: list[RoadMap], looks: Looks, seed: int, decisions: int) -> Pictures:
    task = Bystanders(maps, ROBOTS, START_SPREAD, seed)
    return joined([drive(task, looks, seed, decisions), anywhere(maps, looks, seed)])


def recorded(drives: Sequence[Recorded], twin: Twin, held_out: bool) -> Pictures:
    """What one part of each drive shows. Of what was in its way nobody knows."""
    late_s = twin.found.get("timing.camera_delay_s", (0.0, 0.0))[0]
    parts = []
    for each, poses in zip(drives, twin.places, strict=True):
        view, times_s = LaneView(each.road_map), each.times_s
        ways = *poses[:, :2].T, np.unwrap(poses[:, 2])
        taken = np.column_stack([np.interp(times_s - late_s, times_s, way) for way in ways])
        chosen = np.flatnonzero(held_out == (times_s > (1.0 - HELD_OUT) * times_s[-1]))
        labels = np.array([label(view, pose) for pose in taken[chosen].tolist()])
        labels[:, FREE], labels[:, THING] = np.nan, -1.0
        images = np.array([preprocess(each.images[k], IMAGE) for k in chosen])
        parts.append(Pictures(images, labels))
    return joined(parts)


def errors(sight: OnnxSight, pictures: Pictures) -> Errors:
    """Of what a sight says of these pictures."""
    labels, found = pictures.labels, sight(pictures.images).figures
    lane = (labels[:, CROSSING] == 0.0) & (labels[:, 0] <= IN_LANE_M)
    off = (found - labels[:, : found.shape[1]])[lane]
    off[:, 1] = wrap_angle(off[:, 1])
    return Errors(*np.sqrt(np.mean(off[:, :2] ** 2, axis=0)).tolist())
