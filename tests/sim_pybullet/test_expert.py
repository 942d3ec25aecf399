"""The expert drives every lane: the five actions can take them."""

import numpy as np
import pytest

from robot.contract import ACTION_WHEELS, CONTROL_DT_S, Action
from robot.geometry import Pose
from robot.navigation.path import Path, PathBatch, lane_loop
from robot.navigation.planner import plan_path
from robot.navigation.road_map import load_map
from sim_pybullet.batch import BatchWorld
from sim_pybullet.look import NOMINAL, DriveLook
from sim_pybullet.motors import MotorModel, expert_actions
from sim_pybullet.tasks.following import HALF_LANE_TILES
from sim_pybullet.tasks.lane_keeping import LaneKeeping
from sim_pybullet.town import Town
from tests.sim_pybullet.flat_camera import PoseCamera


@pytest.mark.parametrize("lane", ["outer", "inner"])
def test_drives_two_laps_of_loop_20_of_20(lane: str) -> None:
    world = BatchWorld(LaneKeeping([load_map("loop")], 20, lane), [NOMINAL], camera=PoseCamera(20))
    world.reset()
    ends: dict[int, bool] = {}
    while len(ends) < 20:
        step = world.step(world.expert_actions())
        for i in step.finished.robots.tolist():
            ends.setdefault(i, bool(step.task.success[i]))
    world.close()
    assert all(ends.values())


def follow(path: Path, seconds: float) -> np.ndarray:
    """Distances from the path [m] of the expert on it, from its beginning."""
    town, motors, rng = Town([()], 1), MotorModel(1), np.random.default_rng(0)
    motors.reset(0, DriveLook())
    town.place(0, path.pose_at(0.0))
    batch, offsets, hint = PathBatch([path]), [], None
    for _ in range(round(seconds / CONTROL_DT_S)):
        at = batch.project(town.poses[:, :2], hint)
        hint = at.index
        if not path.closed and at.arc_m[0] > path.length_m - 0.05:
            break
        offsets.append(at.offset_m[0])
        wheels = np.array(ACTION_WHEELS)[expert_actions(batch, town.poses, at.arc_m)]
        for _ in range(3):
            town.step(motors.step(wheels, rng))
    town.close()
    return np.abs(offsets)


def test_stays_in_the_tight_lanes_of_the_arena() -> None:
    """Every ordered pair of six places of the map with 44 cm tiles, through all its junctions."""
    arena = load_map("arena")
    half_lane_m = HALF_LANE_TILES * arena.tile_size_m
    lanes = [arena.lanes[i] for i in np.linspace(0, len(arena.lanes) - 1, 6).astype(int)]
    for start in lanes:
        a, b = start.control_points_m[0], start.control_points_m[1]
        pose = Pose(a[0], a[1], float(np.arctan2(*(b - a)[::-1])))
        for goal in lanes:
            end = goal.control_points_m[3] * 0.5 + goal.control_points_m[2] * 0.5
            path = plan_path(arena, pose, (float(end[0]), float(end[1])))
            if path.length_m > 0.2:
                assert follow(path, 2.0 * path.length_m / 0.18).max() < half_lane_m


def test_steers_towards_the_path_from_either_side() -> None:
    loop = lane_loop(load_map("loop"))
    paths, arc_m = PathBatch([loop]), 1.5
    x, y, heading = loop.pose_at(arc_m)
    assert loop.pose_at(arc_m + 0.2).heading_rad == pytest.approx(heading)
    for side, turns in ((0.05, (Action.RIGHT, Action.SLIGHT_RIGHT)),
                        (-0.05, (Action.LEFT, Action.SLIGHT_LEFT))):  # fmt: skip
        pose = np.array([[x - side * np.sin(heading), y + side * np.cos(heading), heading]])
        assert expert_actions(paths, pose, np.array([arc_m]))[0] in turns
