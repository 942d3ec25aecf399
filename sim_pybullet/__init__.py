"""The simulated world: PyBullet bodies, fisheye cameras, looks, tasks and virtual hardware.

Importing it registers the environments with Gymnasium, by name only: what they need is imported
when one is made.
"""

from typing import Any

import gymnasium

ENVIRONMENTS: dict[str, dict[str, Any]] = {  # id -> arguments of make_lane_keeping
    "duckpilot/LaneKeeping-v0": {},
    "duckpilot/LaneKeepingInner-v0": {"lane": "inner"},
    "duckpilot/LaneKeepingRandomised-v0": {"look": "randomised"},
}

for _id, _arguments in ENVIRONMENTS.items():
    gymnasium.register(_id, "sim_pybullet.env:make_lane_keeping", kwargs=_arguments)
