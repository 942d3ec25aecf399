"""Train PPO with plain stable-baselines3 until a small robot keeps its lane: some ten seconds."""

import sys

import matplotlib.pyplot as plt
from folder import out
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback

from robot.contract import ImageSpec
from sim_pybullet.env import make_world
from sim_pybullet.vec_env import DuckpilotVecEnv

STEPS = int(sys.argv[2]) if len(sys.argv) > 2 else 10_000
ROBOTS = 16


class Ended(BaseCallback):
    """Notes how far each robot came before its episode ended."""

    def __init__(self) -> None:
        super().__init__()
        self.steps: list[int] = []
        self.metres: list[float] = []

    def _on_step(self) -> bool:
        for info, done in zip(self.locals["infos"], self.locals["dones"], strict=True):
            if done:
                self.steps.append(self.num_timesteps)
                self.metres.append(info["travelled_m"])
        return True


env = DuckpilotVecEnv(make_world("lane", ROBOTS, image=ImageSpec(80, 60, 20), pool_size=4))
ended = Ended()
model = PPO("CnnPolicy", env, n_steps=64, batch_size=256, n_epochs=4, gamma=0.9, seed=0)
model.learn(STEPS, callback=ended)
model.save(out / "02_ppo.zip")

plt.plot(ended.steps, ended.metres, ".", color="tab:red")
plt.xlabel("decisions of all robots")
plt.ylabel("driven before the episode ended [m]")
plt.savefig(out / "02_train_ppo.png", dpi=100)
print(f"{len(ended.metres)} episodes; the last one drove {ended.metres[-1]:.1f} m")
env.close()
