"""A task of your own, `own_task.py`: where in the lane does its reward have its optimum?"""

import matplotlib.pyplot as plt
import numpy as np
from folder import out
from own_task import KEEP_RIGHT, RIGHT_M

from sim_pybullet.env import make_world

ROBOTS = 8

world = make_world(KEEP_RIGHT.name, ROBOTS, pool_size=1)
world.reset()
rng = np.random.default_rng(0)
offsets, rewards = [], []
for _ in range(60):
    actions = world.expert_actions()
    wild = rng.random(ROBOTS) < 0.3  # leaves the middle now and then
    step = world.step(np.where(wild, rng.integers(0, 5, ROBOTS), actions))
    offsets += list(step.course.offset_m)
    rewards += list(step.reward)
world.close()

best = offsets[int(np.argmax(rewards))]
print(f"best reward {max(rewards):.2f}, {100 * best:.1f} cm left of the middle")
plt.plot(100.0 * np.array(offsets), rewards, ".", color="tab:red")
plt.axvline(-100.0 * RIGHT_M, color="grey")
plt.xlabel("left of the middle of the lane [cm]")
plt.ylabel("reward of a decision")
plt.savefig(out / "06_own_task.png", dpi=100)
