"""The robot's own runtime drives a shipped policy through virtual camera, HAT and wheels."""

import sys

import cv2
import numpy as np
from folder import out

from robot.geometry import Pose
from robot.inference.policy import SHIPPED_MODELS, OnnxPolicy
from robot.navigation.road_map import load_map
from robot.parts import Tick
from sim_pybullet.look import Look
from sim_pybullet.show import from_above
from tools.loop.laps import LapDrive, LapRecord

LAPS = float(sys.argv[2]) if len(sys.argv) > 2 else 0.5

road_map = load_map("loop")
trail = []


def watch(_tick: Tick, pose: Pose, _record: LapRecord) -> None:
    """Called after every turn of the runtime's loop."""
    trail.append((pose.x_m, pose.y_m))


drive = LapDrive(road_map, Look(), OnnxPolicy(SHIPPED_MODELS / "lane_dueling.onnx"), seed=0)
record = drive.drive(LAPS, watch)
drive.close()
off_cm = 100.0 * np.abs(record.offsets_m).mean()
print(f"{record.laps:.2f} laps in {record.seconds:.1f} s, {off_cm:.1f} cm off the middle")
print(f"steps lost by the motors: {record.lost_steps}; state {record.state}")
picture = from_above(road_map, np.array(trail))
cv2.imwrite(str(out / "09_drive_in_the_loop.png"), picture[..., ::-1])
