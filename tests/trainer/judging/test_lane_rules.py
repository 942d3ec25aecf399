"""Figures of the AI Driving Olympics agree with duckietown-world's on a hundred drives."""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path

import numpy as np
import pytest

from robot.contract import CONTROL_DT_S
from robot.navigation import path as paths
from robot.navigation.path import PathBatch, lane_loop
from robot.navigation.planner import LaneGraph
from robot.navigation.road_map import RoadMap, load_map, shipped_maps
from robot.typed_config import read_yaml
from sim_pybullet.motors import PHYSICS_DT_S, PHYSICS_STEPS, WheeledRobots, expert_actions
from trainer.judging.olympics import LaneRules

# What duckietown-world 6.4.3 said of these drives; the slow test asks it again.
SAID = Path(__file__).with_name("olympics.json")
MAPS = ("loop", "rings/wedge", "rings/zigzag", "rings/bean")
SECONDS = 12.0
TURNS = round(SECONDS / CONTROL_DT_S)
NAMES = {
    "survival_time": "survival_time",
    "driven_lanedir_consec": "driving-distance-consecutive/driven_lanedir_consec",
    "deviation_center_line": "deviation-center-line",
    "in_drivable_lane": "in-drivable-lane",
    "deviation_heading": "deviation-heading",
    "distance_from_start": "distance-from-start",
}


def drives() -> list[tuple[RoadMap, np.ndarray]]:
    """A hundred drives (T, 3): an expert that errs now and then, more often from map to map."""
    found = []
    for k, name in enumerate(MAPS):
        road_map = load_map(name)
        found += [(road_map, drive) for drive in _drives(road_map, 25, np.random.default_rng(k))]
    return found


def _drives(road_map: RoadMap, count: int, rng: np.random.Generator) -> np.ndarray:
    lanes = [lane_loop(road_map, outer=bool(i % 2)) for i in range(count)]
    robots, paths = WheeledRobots(count), PathBatch(lanes)
    arcs = rng.uniform(0.0, [lane.length_m for lane in lanes])
    poses = np.array([lane.pose_at(arc) for lane, arc in zip(lanes, arcs, strict=True)])
    astray = np.linspace(0.0, 0.35, count)  # share of actions that are anything
    wanted, track = np.zeros(count, int), [poses.copy()]
    for turn in range(TURNS):
        if turn % 4 == 0:
            errs = rng.random(count) < astray
            anything = rng.integers(5, size=count)
        right = expert_actions(
            paths, poses, paths.project(poses[:, :2], paths.index_at(arcs)).arc_m
        )
        wanted = np.where(errs, anything, right)
        for _ in range(PHYSICS_STEPS):
            forward, turned = robots.step(wanted, rng).T
            poses[:, 0] += PHYSICS_DT_S * forward * np.cos(poses[:, 2])
            poses[:, 1] += PHYSICS_DT_S * forward * np.sin(poses[:, 2])
            poses[:, 2] += PHYSICS_DT_S * turned
        arcs = paths.project(poses[:, :2], np.full(count, -1)).arc_m
        track.append(poses.copy())
    return np.swapaxes(np.array(track), 0, 1)


def agree(said: list[dict[str, float]]) -> None:
    every = drives()
    assert len(said) == len(every) == 100
    away = []
    for (road_map, poses), theirs in zip(every, said, strict=True):
        ours = LaneRules(road_map).figures(poses, CONTROL_DT_S)._asdict()
        metres = {"deviation_center_line": road_map.tile_size_m}  # theirs is in tiles
        for name, key in NAMES.items():
            said_m = theirs[key] * metres.get(name, 1.0)
            away.append((abs(ours[name] - said_m), name, ours[name], said_m))
    metres = [a for a in away if a[1] in ("driven_lanedir_consec", "distance_from_start")]
    assert max(metres)[0] <= 1e-4, max(metres)
    others = [a for a in away if a not in metres]
    assert max(others)[0] <= 1e-4, max(others)


def test_figures_agree_with_what_duckietown_world_said() -> None:
    agree(json.loads(SAID.read_text()))


@pytest.mark.slow
@pytest.mark.skipif("DUCKIETOWN_WORLD" not in os.environ, reason="needs a Python that has it")
def test_duckietown_world_says_it_again() -> None:
    """``DUCKIETOWN_WORLD=PYTHON``: one with ``pip install duckietown-world-daffy``."""
    tracks = [{"map": m.name, "poses": poses.round(9).tolist()} for m, poses in drives()]
    maps = {Path(name).name: read_yaml(shipped_maps()[name]) for name in MAPS}
    asked = {"dt_s": CONTROL_DT_S, "maps": maps, "drives": tracks}
    program = [os.environ["DUCKIETOWN_WORLD"], str(SAID.with_name("ask_olympics.py"))]
    told = subprocess.run(
        program, input=json.dumps(asked), capture_output=True, text=True, check=True
    )
    said = json.loads(told.stdout)
    if "WRITE" in os.environ:
        keep = [{key: round(row[key], 6) for key in NAMES.values()} for row in said]
        SAID.write_text(json.dumps(keep, indent=0) + "\n")
    agree(said)


def test_a_red_line_is_run_by_who_does_not_stand_before_it() -> None:
    town = load_map("town")
    rules, graph = LaneRules(town), LaneGraph(town)
    crossing = next(lane for lane in graph.lanes if lane.tile.is_junction)
    path = paths.Path.from_beziers([crossing.control_points_m])
    drive = np.array([path.pose_at(arc_m) for arc_m in np.arange(-0.55, 0.5, 0.03)])
    stood = np.insert(drive, [14] * 5, drive[14], axis=0)
    assert rules.lines_run(drive, CONTROL_DT_S) == 1
    assert rules.lines_run(stood, CONTROL_DT_S) == 0
    too_early = np.insert(drive, [3] * 5, drive[3], axis=0)
    assert rules.lines_run(too_early, CONTROL_DT_S) == 1
    tiles = [town.tile_at(x_m, y_m) for x_m, y_m in drive[:, :2].tolist()]
    first = next(k for k, tile in enumerate(tiles) if tile is not None and tile.is_junction)
    too_late = np.insert(drive, [first] * 5, drive[first], axis=0)
    assert rules.lines_run(too_late, CONTROL_DT_S) == 1
    creeping = np.insert(drive, [14] * 5, np.linspace(drive[13], drive[14], 7)[1:-1], axis=0)
    assert rules.lines_run(creeping, CONTROL_DT_S) == 1  # at 5 cm/s
    assert rules.lines_run(drive[10:], CONTROL_DT_S) == 0  # began in the zone
