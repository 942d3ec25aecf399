"""Explain a picture: where a shipped policy looks, and what would change its mind."""

import cv2
import numpy as np
from folder import out

from robot.inference.policy import SHIPPED_MODELS
from robot.inference.preprocess import preprocess
from robot.navigation.road_map import load_map
from sim_pybullet.randomise import load_look_sampler
from sim_pybullet.show import draws
from trainer.judging.explain import Explainer, overlay

explainer = Explainer(SHIPPED_MODELS / "nav_ppo.onnx")
frames = draws(load_map("town"), load_look_sampler("randomised"), 4, np.random.default_rng(3))
rows = []
for frame in frames:
    picture = preprocess(frame, explainer.contract.image)
    features = explainer.attention(picture[None])[0]
    influence = explainer.influence(picture)
    row = np.hstack([picture, overlay(picture, features), overlay(picture, influence)])
    rows.append(cv2.resize(row, None, fx=4, fy=4, interpolation=cv2.INTER_NEAREST))
    brightest = np.unravel_index(influence.argmax(), influence.shape)
    print(f"most influence at row {brightest[0]}, column {brightest[1]}")
cv2.imwrite(str(out / "11_explain.png"), np.vstack(rows)[..., ::-1])
