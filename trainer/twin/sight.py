"""Sight learns on in a twin, in the looks of before, and from what a recording shows.

The recorded pictures are labelled by the map, from where the fit puts the robot.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from rich.console import Console
from rich.progress import track

from robot.geometry import wrap_angle
from robot.inference.preprocess import preprocess
from robot.navigation.lane_view import LaneView
from robot.navigation.road_map import load_map
from robot.vision.sight import OnnxSight
from sim_pybullet.randomise import Sites, load_look_sampler, look_sampler
from trainer.division import division
from trainer.sight import pictures as seen
from trainer.sight.bystanders import Bystanders
from trainer.sight.cli import SightRun
from trainer.sight.network import SightNetwork, calibrate, export_sight, half_way
from trainer.sight.train import Batches, lesson
from trainer.twin.examples import HELD_OUT
from trainer.twin.fit import Twin
from trainer.twin.recorded import Recorded
from trainer.twin.teach import USUAL

DECISIONS, CHECKED = 200, 30  # of experts in each world: to learn from, and to scale by
RATE = 2e-4


def teach_sight(
    network: SightNetwork, drives: Sequence[Recorded], twin: Twin, run: SightRun, out: Path
) -> np.ndarray:
    """Let a network learn on and write sight.onnx; the `errors` of its base and it, (2, 2).

    Of ``run`` base, steps, batch and seed count.
    """
    base, path = OnnxSight(run.base or ""), out / "sight.onnx"
    training = [load_map(name) for name in division().maps.training]
    own, usual = look_sampler(twin.plain(), "twin"), Sites(map(load_look_sampler, USUAL))
    learn, scale = list[seen.Pictures](), list[seen.Pictures]()
    for some, decisions, seed in ((learn, DECISIONS, run.seed), (scale, CHECKED, run.seed + 1)):
        for maps, look in (([drives[0].road_map], own), (training, usual)):
            task = Bystanders(maps, seen.ROBOTS, seen.START_SPREAD, seed)
            some += [seen.drive(task, look, seed, decisions), seen.anywhere(maps, look, seed)]
    shown, held_out = (recorded(drives, twin, part) for part in (False, True))
    optimiser = torch.optim.AdamW(network.parameters(), RATE)
    step = lesson(network.train(), optimiser, Batches(seen.joined([*learn, shown]), None, run))
    for number in track(range(run.steps), "teaching", console=Console(soft_wrap=True)):
        step(np.random.default_rng(number), number)
    half_way(network, Path(run.base or ""))
    calibrate(network, seen.joined(scale))
    steps = base.contract.trained_steps + run.steps
    contract = replace(base.contract, run=out.name, trained_steps=steps)
    export_sight(network, contract, held_out.images, path)
    return np.array([errors(sight, held_out) for sight in (base, OnnxSight(path))])


def recorded(drives: Sequence[Recorded], twin: Twin, held_out: bool) -> seen.Pictures:
    """What one part of each drive shows. Of what was in its way nobody knows."""
    late_s = twin.found.get("timing.camera_delay_s", (0.0, 0.0))[0]
    parts = []
    for each, poses in zip(drives, twin.places, strict=True):
        view, times_s = LaneView(each.road_map), each.times_s
        ways = *poses[:, :2].T, np.unwrap(poses[:, 2])
        taken = np.column_stack([np.interp(times_s - late_s, times_s, way) for way in ways])
        chosen = np.flatnonzero(held_out == (times_s > (1.0 - HELD_OUT) * times_s[-1]))
        labels = np.array([seen.label(view, pose) for pose in taken[chosen].tolist()])
        labels[:, seen.FREE], labels[:, seen.THING] = np.nan, -1.0
        images = np.array([preprocess(each.images[k], seen.IMAGE) for k in chosen])
        parts.append(seen.Pictures(images, labels))
    return seen.joined(parts)


def errors(sight: OnnxSight, pictures: seen.Pictures) -> np.ndarray:
    """Root mean squares in lanes outside junctions: offset [m] and heading [rad]."""
    labels, found = pictures.labels, sight(pictures.images).figures
    lane = (labels[:, seen.CROSSING] == 0.0) & (labels[:, 0] <= seen.IN_LANE_M)
    off = (found[:, :2] - labels[:, :2])[lane]
    off[:, 1] = wrap_angle(off[:, 1])
    return np.asarray(np.sqrt(np.mean(off**2, axis=0)))
