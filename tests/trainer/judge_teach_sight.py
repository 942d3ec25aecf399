"""``python -m tests.trainer.judge_teach_sight``: teach sight floors it never saw, and judge it.

The floors of `tests.trainer.judge_teach`. A virtual person drives them on one map; the sight taught
there is judged on others of the same floor, as is the one that it learned on from: by pictures, and
by missions without an overhead pose after the start.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from robot.command_line import OneLineParser, whole
from robot.inference.policy import SHIPPED_MODELS, OnnxPolicy
from robot.navigation.road_map import load_map
from robot.vision.sight import OnnxSight
from sim_pybullet.look import ARENA_POSE, NOMINAL, Look
from sim_pybullet.sensing.guidance_feed import PoseSources
from sim_pybullet.tasks.navigation import Navigation
from tests.trainer.judge_teach import FIRST, floors, tell
from tests.trainer.virtual_drive import record_drive
from trainer.division import division, maps_named
from trainer.judging.evaluate import ridden
from trainer.sight.pictures import ROBOTS, START_SPREAD, drive
from trainer.twin.cli import teach_command
from trainer.twin.sight import errors
from trainer.twin.teach import base_file

NAVIGATOR = SHIPPED_MODELS / "nav_ppo.onnx"
DECISIONS = 60  # of `ROBOTS` experts, by which pictures are judged


@dataclass(frozen=True)
class Floor:
    """What teaching did to one floor, and to the nominal look; root mean squares."""

    floor: str
    offset_cm: tuple[float, float]  # before and after
    heading_deg: tuple[float, float]
    nominal_offset_cm: tuple[float, float]
    nominal_heading_deg: tuple[float, float]
    arrived: tuple[int, int]  # of ``missions``
    missions: int
    kept: bool  # what was taught, says teach


def err(sight: Path, maps: Sequence[str], look: Look) -> tuple[float, float]:
    """Offset [cm] and heading [degrees], in pictures of disturbed experts."""
    task = Navigation([load_map(name) for name in maps], ROBOTS, START_SPREAD)
    found = errors(OnnxSight(sight), drive(task, [look], FIRST, DECISIONS))
    return 100.0 * float(found[0]), math.degrees(found[1])


def arrived(sight: Path, maps: Sequence[str], look: Look, missions: int) -> int:
    """Missions that arrive; robots are told their pose at the start only."""
    policy, places = OnnxPolicy(NAVIGATOR), [load_map(name) for name in maps]
    sources = PoseSources("start", OnnxSight(sight))
    numbers, looks = range(FIRST, FIRST + missions), [replace(look, pose=ARENA_POSE)]
    rides = ridden(policy, "navigation", places, looks, numbers, sources=sources)
    return sum(done.success for done, _ in rides)


def judge(options: argparse.Namespace, folder: Path) -> Iterator[Floor]:
    """One floor after the other."""
    base = base_file(options.base)
    towns = maps_named(["judging/towns"])
    everywhere = division().maps.judging
    for k, (name, look) in enumerate(floors(options.seed)):
        if options.floors and name not in options.floors:
            continue
        path = record_drive(look, options.map, options.seconds, options.seed + k, folder / "d.mcap")
        out = folder / name
        status = teach_command((path,), str(base), out, steps=options.steps, seed=options.seed)
        path.unlink()
        both = base, out / "sight.onnx"
        there, usual = ([err(s, everywhere, at) for s in both] for at in (look, NOMINAL))
        offset_cm, heading_deg = zip(*there, strict=True)
        nominal_cm, nominal_deg = zip(*usual, strict=True)
        came = tuple(arrived(s, towns, look, options.missions) for s in both)
        yield Floor(
            name,
            *(offset_cm, heading_deg, nominal_cm, nominal_deg),
            (came[0], came[1]),
            options.missions,
            status == 0,
        )


def main() -> int:
    """Judge sights."""
    parser = OneLineParser(prog="python -m tests.trainer.judge_teach_sight", description=__doc__)
    parser.add_argument("--base", default="sight", help="an ONNX file or a shipped sight")
    parser.add_argument("--map", default="arena", help="that is driven and recorded")
    parser.add_argument("--steps", type=whole(1, 100_000), default=900, help="of learning")
    parser.add_argument("--missions", type=whole(1, 1000), default=40, help="on each true floor")
    return tell(parser, judge)


if __name__ == "__main__":
    sys.exit(main())
