"""``python -m tests.trainer.judge_tubs FOLDER...``: teach by people's drives without a map.

Each folder is a drive as `trainer.experiments.records` knows them, at a throttle of 0.6. ``teach``
learns from its first part and is asked about the rest (``--judged``), twenty frames later: in how
many moments of clear steering it steers to the person's side, before and after; and how many turns
it tells (left, straight, right, by the mean of its curvatures), as Table 1 of paper B counts.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch

from robot.command_line import OneLineParser, number, whole
from robot.contract import DRIVE, FIVE_ACTIONS, PolicyContract, Stick, WheelSpeeds
from robot.output import write_json
from robot.recording.topics import Turn
from trainer.experiments.records import FULL_LOCK_DEG, frames_of, load_drive, turns
from trainer.learners.networks import GreedyNetwork
from trainer.twin import examples
from trainer.twin.examples import Examples, examples_of, foretold
from trainer.twin.recorded import Recorded
from trainer.twin.teach import base_file, how_much, load_base, teach

GAP, EVERY_S, THROTTLE = 20, 0.05, 0.6
_BENDS = [DRIVE.twist(WheelSpeeds(*wheels)) for wheels in FIVE_ACTIONS]
BENDS_PM = np.array([bend.turn_radps / bend.forward_mps for bend in _BENDS])


class Told(NamedTuple):
    """What a network tells of a person's steering."""

    side: int  # moments of clear steering to the person's side,
    clear: int  # of so many
    turns: int  # told right,
    asked: int  # of so many


def recorded(folder: Path) -> Recorded:
    """A person's drive."""
    drive = load_drive(folder)
    wheels = [Stick(-deg / FULL_LOCK_DEG, THROTTLE).wheels for deg in drive.steering_deg.tolist()]
    times_s = EVERY_S * np.arange(len(wheels))
    told = [
        Turn(k, time_s, 0.01, 0.0, "MANUAL", "", "", pair)
        for k, (time_s, pair) in enumerate(zip(times_s.tolist(), wheels, strict=True))
    ]
    nowhere = np.zeros((0, 4))
    return Recorded(
        "", np.zeros((0, 2)), times_s, frames_of(drive), nowhere, nowhere, 0.0, tuple(told)
    )


def ask(network: GreedyNetwork, contract: PolicyContract, seen: Examples) -> Told:
    """By its values; by the mean of its curvatures, what it turns."""
    with torch.no_grad():
        mean_pm = network.logits(seen.observed).softmax(1).numpy() @ BENDS_PM
    lock_pm = BENDS_PM.max() / FULL_LOCK_DEG
    right = turns(-mean_pm / lock_pm) == turns(-seen.bends_pm / lock_pm)
    actions = network.actions(seen.observed)
    return Told(*foretold(actions, seen, contract), int(right.sum()), len(right))


def judge(folder: Path, base: str, steps: int, seed: int) -> list[Told]:
    """Before and after."""
    torch.manual_seed(seed)
    network, contract = load_base(base_file(base))
    drive = recorded(folder)
    where = [drive], [None], contract
    person, rest = examples_of(*where, held_out=False), examples_of(*where, held_out=True)
    rest = Examples(*(None if part is None else part[GAP:] for part in rest))
    told = [ask(network, contract, rest)]
    teach(network, contract, None, person, how_much(False, steps), seed)
    return [*told, ask(network, contract, rest)]


def main() -> int:
    """Print and write what came of each."""
    parser = OneLineParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("folders", type=Path, nargs="+")
    parser.add_argument("--base", default="lane_sight")
    parser.add_argument("--steps", type=whole(1, 100_000), default=900)
    parser.add_argument("--seeds", type=whole(1, 100), default=3)
    parser.add_argument("--judged", type=number(0.05, 0.95), default=0.4, help="share of a drive")
    parser.add_argument("--json", type=Path)
    asked = parser.parse_args()
    examples.HELD_OUT = asked.judged
    torch.set_num_threads(1)
    rows = []
    for folder in asked.folders:
        for seed in range(asked.seeds):
            before, after = judge(folder, asked.base, asked.steps, seed)
            print(f"{folder.name}, seed {seed}: before {before}, after {after}", flush=True)
            both = {"before": before._asdict(), "after": after._asdict()}
            rows.append({"drive": folder.name, "base": asked.base, "seed": seed, **both})
    if asked.json is not None:
        write_json(asked.json, rows)
    return 0


if __name__ == "__main__":
    sys.exit(main())
