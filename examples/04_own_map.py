"""A map of your own, a mission through it, and both seen from above."""

import cv2
from folder import out

from robot.geometry import Pose
from robot.navigation.planner import plan_path
from robot.navigation.road_map import load_map
from sim_pybullet.show import from_above

own = out / "04_own_map.yaml"
own.write_text("""
tile_size: 0.585
tiles:
- [curve_left/W, straight/W, 3way_left/W, straight/W, curve_left/N]
- [straight/S,   grass,      straight/S,  grass,      straight/N]
- [curve_left/S, straight/E, 3way_left/E, straight/E, curve_left/E]
""")
road_map = load_map(own)
start = Pose(1.35 * road_map.tile_size_m, 0.29, 0.0)  # on the southern street, heading east
goal_m = (0.30 * road_map.tile_size_m, 1.5 * road_map.tile_size_m)  # on the western one
path = plan_path(road_map, start, goal_m)
print(f"{len(road_map.road_tiles)} tiles of road; the mission is {path.length_m:.2f} m long")
cv2.imwrite(str(out / "04_own_map.png"), from_above(road_map, path.points_m)[..., ::-1])
