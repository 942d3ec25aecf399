"""Localize robots in one picture of the overhead camera; here the picture is drawn, too."""

import math

import cv2
import numpy as np
from folder import out

from localizer_node.calibration import Board, Calibration, Marker
from localizer_node.detect import annotated
from localizer_node.node import locate_frame
from robot.geometry import Pose
from robot.navigation.road_map import load_map
from sim_pybullet.look import Look
from sim_pybullet.overhead import OverheadCamera, robot_sheets
from sim_pybullet.scenery.objects import build_scene

arena = load_map("arena")
rng = np.random.default_rng(0)
camera = OverheadCamera(build_scene(arena, Look(), rng).ground)
ann = Marker("ann", "two_colour", front="green", board=Board(height_m=0.12))
bob = Marker("bob", "two_colour", front="magenta", board=Board(height_m=0.12))
poses = {"ann": Pose(0.35, 1.5, math.pi / 2), "bob": Pose(1.4, 0.31, 0.0)}
sheets = [s for one in (ann, bob) for s in robot_sheets(one, poses[one.robot])]
image = camera.render(sheets, rng)

size_m = (arena.width_m, arena.height_m)
calibration = Calibration(camera.lens, camera.hanging, map_size_m=size_m, robots=(ann, bob))
found = locate_frame(image, calibration)  # yours: load_yaml(Calibration, "arena.yaml")
for one in found:
    true = poses[one.robot]
    error_mm = 1000.0 * math.hypot(one.x_m - true.x_m, one.y_m - true.y_m)
    degrees = math.degrees(one.heading_rad or 0.0)
    print(f"{one.robot}: {one.x_m:.3f}, {one.y_m:.3f} m, {degrees:.0f} degrees, {error_mm:.1f} mm")
picture = annotated(image, calibration, found)
cv2.imwrite(str(out / "12_localize.png"), picture[..., ::-1])
