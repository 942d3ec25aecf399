"""An actor-critic in one loop, as CleanRL writes them: 16 robots, no framework but torch."""

import sys

import matplotlib.pyplot as plt
import numpy as np
import torch
from folder import out
from torch import nn

from robot.contract import ImageSpec
from sim_pybullet.env import make_world
from sim_pybullet.vec_env import DuckpilotVecEnv

UPDATES = int(sys.argv[2]) if len(sys.argv) > 2 else 150
ROBOTS, STEPS, GAMMA = 16, 8, 0.9
torch.manual_seed(0)

env = DuckpilotVecEnv(make_world("lane", ROBOTS, image=ImageSpec(80, 60, 20), pool_size=4))
convolutions = nn.Conv2d(3, 16, 8, 4), nn.ReLU(), nn.Conv2d(16, 32, 4, 2), nn.ReLU()
heads = nn.LazyLinear(128), nn.ReLU(), nn.Linear(128, env.action_space.n + 1)
network = nn.Sequential(*convolutions, nn.Flatten(), *heads)


def look(pictures: np.ndarray) -> tuple[torch.distributions.Categorical, torch.Tensor]:
    """What to do in pictures (N, H, W, 3), and what they are worth."""
    out = network(torch.as_tensor(pictures).permute(0, 3, 1, 2) / 127.5 - 1.0)
    return torch.distributions.Categorical(logits=out[:, :-1]), out[:, -1]


pictures, means = env.reset(), []
look(pictures)  # makes the lazy layer's weights
optimiser = torch.optim.Adam(network.parameters(), lr=1e-3)
for _ in range(UPDATES):
    steps = []
    for _ in range(STEPS):
        policy, values = look(pictures)
        actions = policy.sample()
        pictures, rewards, dones, _ = env.step(actions.numpy())
        steps.append((policy.log_prob(actions), values, policy.entropy(), rewards * 0.05, ~dones))
    future = look(pictures)[1].detach()
    loss = 0.0
    for log_prob, values, entropy, rewards, going in reversed(steps):
        future = torch.as_tensor(rewards).float() + GAMMA * torch.as_tensor(going) * future
        gain = future - values
        loss += (gain.square() - gain.detach() * log_prob - 0.01 * entropy).mean()
    optimiser.zero_grad()
    loss.backward()
    optimiser.step()
    means.append(np.mean([step[3] for step in steps]) / 0.05)
plt.plot(means)
plt.savefig(out / "03_cleanrl_loop.png", dpi=100)
print(f"reward {np.mean(means[:10]):.2f} at first, {np.mean(means[-10:]):.2f} at last")
