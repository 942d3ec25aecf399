"""A task of your own: keep right, 3 cm beside the middle of the lane, at its reward's optimum."""

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from robot.navigation.road_map import load_map
from sim_pybullet.batch import BatchWorld
from sim_pybullet.randomise import load_look_sampler
from sim_pybullet.tasks.base import TaskStep
from sim_pybullet.tasks.following import following_terms
from sim_pybullet.tasks.lane_keeping import LaneKeeping

out = Path(sys.argv[1] if len(sys.argv) > 1 else "runs/examples")
RIGHT_M, ROBOTS = 0.03, 8


class KeepRight(LaneKeeping):
    """Lane keeping whose best place is beside the middle."""

    def step(self, poses: np.ndarray, collided: np.ndarray) -> TaskStep:
        """Reward and end of the decision that led to poses (N, 3)."""
        judged = super().step(poses, collided)
        beside = self.course._replace(offset_m=self.course.offset_m + RIGHT_M)
        return judged._replace(terms=following_terms(beside, self.half_lane_m))


task = KeepRight([load_map("loop")], ROBOTS)
world = BatchWorld(task, load_look_sampler("nominal"), pool_size=1)
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
out.mkdir(parents=True, exist_ok=True)
plt.savefig(out / "06_own_task.png", dpi=100)
