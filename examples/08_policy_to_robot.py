"""A torch network of your own becomes an ONNX file that the robot accepts, and decides on it."""

import cv2
import numpy as np
import torch
from folder import out
from torch import nn

from robot.contract import ACTION_WHEELS, Action, ImageSpec, PolicyContract
from robot.inference.policy import OnnxPolicy
from robot.inference.preprocess import preprocess
from robot.navigation.road_map import load_map
from sim_pybullet.randomise import load_look_sampler
from sim_pybullet.show import draws
from trainer.export import export_network


class Own(nn.Module):
    """uint8 (N, H, W, 3) in, values (N, 5) out: any network between."""

    def __init__(self) -> None:
        super().__init__()
        self.body = nn.Sequential(
            *(nn.Conv2d(3, 8, 8, 4), nn.ReLU(), nn.Flatten(), nn.LazyLinear(len(ACTION_WHEELS)))
        )

    def forward(self, image: torch.Tensor) -> torch.Tensor:
        """Pixels as 0..1, colours first."""
        return self.body(image.permute(0, 3, 1, 2).float() / 255.0)


torch.manual_seed(0)
image = ImageSpec(80, 60, 20)
network = Own()
network(torch.zeros(1, *image.shape, dtype=torch.uint8))  # makes the lazy layer
file = out / "08_own.onnx"
export_network(network, PolicyContract("lane", "own", image, run="example"), file)

policy = OnnxPolicy(file)  # what the robot loads; refuses whatever breaks the contract
frame = draws(load_map("loop"), load_look_sampler("nominal"), 1, np.random.default_rng(0))[0]
values = policy.values(preprocess(frame, policy.contract.image)[None])[0]
print(f"{file.name}: {Action(int(values.argmax())).name}, values {values.round(2)}")
shown = cv2.resize(frame, None, fx=3, fy=3, interpolation=cv2.INTER_NEAREST)[..., ::-1].copy()
for action, value in zip(Action, values, strict=True):
    text = f"{action.name.lower()} {value:.2f}"
    cv2.putText(shown, text, (8, 20 + 20 * action), 0, 0.5, (0, 0, 200), 1, cv2.LINE_AA)
cv2.imwrite(str(out / "08_policy_to_robot.png"), shown)
