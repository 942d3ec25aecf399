"""A reward of your own, as a Gymnasium wrapper: smooth driving pays."""

from typing import Any

import gymnasium
import matplotlib.pyplot as plt
from folder import out

import sim_pybullet  # noqa: F401 (registers the environments)

CHANGE_COSTS = 2.0


class Smooth(gymnasium.Wrapper):
    """Takes away some reward whenever the action changes."""

    last: Any = None

    def reset(self, **arguments: Any) -> Any:
        """Forget the last action."""
        self.last = None
        return self.env.reset(**arguments)

    def step(self, action: Any) -> Any:
        """The world's own terms lie in ``info["terms"]``."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        changed = self.last is not None and action != self.last
        self.last = action
        return observation, float(reward) - CHANGE_COSTS * changed, terminated, truncated, info


env = Smooth(gymnasium.make("duckpilot/LaneKeeping-v0", pool_size=1))
env.reset(seed=1)
rows = []
for _ in range(60):
    action = int(env.unwrapped.world.expert_actions()[0])
    _, reward, _, _, info = env.step(action)
    rows.append((sum(info["terms"].values()), reward))
plain, smooth = zip(*rows, strict=True)
plt.plot(plain, label="the task's reward")
plt.plot(smooth, label="less what changes of mind cost")
plt.xlabel("decisions of 0.1 s")
plt.legend()
plt.savefig(out / "07_own_reward.png", dpi=100)
print(f"{sum(plain):.0f} by the task's reward, {sum(smooth):.0f} by ours")
env.close()
