"""A look of your own: evening light, worn paint, a camera that somebody mounted by hand."""

import cv2
import numpy as np
import yaml
from folder import out

from robot.navigation.road_map import load_map
from sim_pybullet.randomise import look_sampler
from sim_pybullet.show import draws, sheet

evening = yaml.safe_load("""
sky: {horizon_rgb: [120.0, 84.0, 70.0], zenith_rgb: [40.0, 42.0, 70.0]}
ground:
  brightness: {log_uniform: [0.6, 1.4]}
  wear: {uniform: [0.1, 0.5]}
camera:
  height_m: {uniform: [0.095, 0.125]}
  pitch_rad: {uniform: [0.27, 0.40]}
sensor:
  exposure: {uniform: [0.7, 1.2]}
  white_balance: [1.3, 1.0, 0.6]
""")
(out / "05_own_look.yaml").write_text(yaml.safe_dump(evening))  # for train --look
pictures = draws(load_map("town"), look_sampler(evening), 12, np.random.default_rng(0))
cv2.imwrite(str(out / "05_own_look.png"), sheet(pictures)[..., ::-1])
print(f"{len(pictures)} draws; mean brightness {pictures.mean():.0f} of 255")
