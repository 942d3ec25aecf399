"""``python -m tests.trainer.judge_teach``: teach a policy floors it never saw, and judge it there.

Each site of ``reality`` under two cameras: one fixed look, driven by a virtual person in the
batched world and recorded, then taught through ``duckpilot teach``. Judged on the true floor before
and after, and in the nominal look; the proof's forecast is held against the truth.
"""

from __future__ import annotations

import argparse
import math
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from robot.command_line import OneLineParser, number, whole
from robot.inference.policy import OnnxPolicy
from robot.navigation.road_map import load_map
from robot.output import write_json
from sim_pybullet.look import ARENA_POSE, NOMINAL, CameraLook, Look
from sim_pybullet.randomise import load_look_sampler
from sim_pybullet.tasks.spec import find_task
from tests.trainer.virtual_drive import record_drive
from trainer.judging.evaluate import ridden
from trainer.twin.cli import teach_command
from trainer.twin.teach import base_file

SITES = ("hall", "lab", "night", "noon", "rink")
CAMERAS = {
    "nominal": CameraLook(),
    "askew": replace(
        CameraLook(),
        height_m=CameraLook().height_m + 0.015,
        pitch_rad=CameraLook().pitch_rad + math.radians(7.0),
    ),
}
FIRST = 70_000  # number of the first drive by which a floor is judged


@dataclass(frozen=True)
class Floor:
    """What teaching did to one floor."""

    floor: str
    before: int  # of ``drives`` on the true floor, by the base
    after: int
    nominal_before: int  # in the nominal look, of a fifth as many
    nominal_after: int
    drives: int
    forecast: int | None  # of 100, in its twin; without a map there is none
    armed: bool
    cpu_s: float  # of the teaching


def floors(seed: int) -> Iterator[tuple[str, Look]]:
    """Each site under each camera; a look is drawn once and stays."""
    for site in SITES:
        look = load_look_sampler(f"reality/{site}")(np.random.default_rng((seed, 4)))
        for name, camera in CAMERAS.items():
            yield f"{site}_{name}", replace(look, camera=camera)


def succeeded(model: Path, map_name: str, look: Look, drives: int) -> int:
    """Drives of a policy on a map in a fixed look that reach their end."""
    policy = OnnxPolicy(model)
    task = policy.contract.task
    lane = "both" if find_task(task).lanes else None
    look = replace(look, pose=ARENA_POSE) if policy.contract.path_points else look
    numbers = range(FIRST, FIRST + drives)
    road_map = load_map(map_name)
    return sum(
        done.success for done, _ in ridden(policy, task, [road_map], [look], numbers, lane=lane)
    )


def judge(options: argparse.Namespace, folder: Path) -> Iterator[Floor]:
    """One floor after the other."""
    base = base_file(options.base)
    few = max(1, options.drives // 5)
    nominal_before = succeeded(base, options.map, NOMINAL, few)
    for k, (name, look) in enumerate(floors(options.seed)):
        if options.floors and name not in options.floors:
            continue
        how = options.seconds, options.seed + k, folder / "d.mcap"
        path = record_drive(look, options.map, *how, mapped=not options.without_map)
        out, began_s = folder / name, time.process_time()
        more = {"cyclegan": options.cyclegan, "seed": options.seed}
        status = teach_command((path,), str(base), out, **more)
        cpu_s = time.process_time() - began_s
        path.unlink()
        model = out / "model.onnx"
        proof = OnnxPolicy(model).contract.proof
        assert proof is not None
        yield Floor(
            name,
            succeeded(base, options.map, look, options.drives),
            succeeded(model, options.map, look, options.drives),
            nominal_before,
            succeeded(model, options.map, NOMINAL, few),
            options.drives,
            round(100 * proof.succeeded / proof.drives) if proof.drives else None,
            status == 0,
            cpu_s,
        )


def tell(
    parser: argparse.ArgumentParser, judge: Callable[[argparse.Namespace, Path], Iterator[Any]]
) -> int:
    """Print each floor, and write them, as options that both judges have say."""
    parser.add_argument("--seconds", type=number(20, 1200), default=180.0, help="of each drive")
    parser.add_argument("--floors", nargs="*", help="such as noon_askew; all without")
    parser.add_argument("--seed", type=whole(0, 2**31 - 1), default=0)
    parser.add_argument("--json", type=Path, help="write the figures")
    options = parser.parse_args()
    done = []
    with tempfile.TemporaryDirectory() as folder:
        for floor in judge(options, Path(folder)):
            done.append(asdict(floor))
            print(", ".join(f"{k} {v}" for k, v in done[-1].items()), flush=True)
            if options.json:
                write_json(options.json, {"floors": done})
    return 0


def main() -> int:
    """Judge policies."""
    parser = OneLineParser(prog="python -m tests.trainer.judge_teach", description=__doc__)
    parser.add_argument("--base", default="lane_coached", help="an ONNX file or a shipped policy")
    parser.add_argument("--map", default="rings/claw", help="of a ring, or a town for navigators")
    parser.add_argument("--without-map", action="store_true", help="recordings tell of none")
    parser.add_argument("--cyclegan", type=whole(0, 10**6), default=0, help="as of teach")
    parser.add_argument("--drives", type=whole(1, 1000), default=50, help="on each true floor")
    return tell(parser, judge)


if __name__ == "__main__":
    sys.exit(main())
