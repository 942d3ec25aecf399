"""A world in ten lines: an expert drives four seconds, and the last picture is kept."""

import cv2
import gymnasium
from folder import out

import sim_pybullet  # noqa: F401 (registers the environments)

env = gymnasium.make("duckpilot/LaneKeeping-v0", render_mode="rgb_array", pool_size=1)
observation, info = env.reset(seed=0)
for _ in range(40):
    action = env.unwrapped.world.expert_actions()[0]  # your policy instead
    observation, reward, terminated, truncated, info = env.step(action)
print(f"reward {reward:.2f}, {info['travelled_m']:.2f} m driven, {info['offset_m']:.3f} m off")
picture = cv2.resize(env.render(), None, fx=3, fy=3, interpolation=cv2.INTER_NEAREST)
cv2.imwrite(str(out / "01_world.png"), picture[..., ::-1])
env.close()
