"""Train PPO with plain stable-baselines3 until a small robot keeps its lane: some ten seconds."""

import sys

import matplotlib.pyplot as plt
import numpy as np
from folder import out
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecMonitor

from robot.contract import ImageSpec
from sim_pybullet.env import make_world
from sim_pybullet.vec_env import DuckpilotVecEnv

STEPS = int(sys.argv[2]) if len(sys.argv) > 2 else 10_000

world = make_world("lane", 16, image=ImageSpec(80, 60, 20), pool_size=4)
env = VecMonitor(DuckpilotVecEnv(world), info_keywords=("travelled_m",))
settings = {"n_steps": 64, "batch_size": 256, "n_epochs": 4, "gamma": 0.9, "seed": 0}
model = PPO("CnnPolicy", env, stats_window_size=STEPS, **settings)
model.learn(STEPS)
model.save(out / "02_ppo.zip")

episodes = model.ep_info_buffer
metres = [episode["travelled_m"] for episode in episodes]
plt.plot(np.cumsum([episode["l"] for episode in episodes]), metres, ".", color="tab:red")
plt.xlabel("decisions of all robots")
plt.ylabel("driven before the episode ended [m]")
plt.savefig(out / "02_train_ppo.png", dpi=100)
print(f"{len(metres)} episodes; the last one drove {metres[-1]:.1f} m")
env.close()
