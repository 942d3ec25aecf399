"""The simulated world: PyBullet bodies, fisheye cameras, looks, tasks and virtual hardware.

Importing it registers the environments with Gymnasium, by name only: what they need is imported
when one is made. Where Gymnasium is absent (the robot's own tests need only the virtual hardware)
nothing is registered.
"""

from __future__ import annotations

import importlib.util
from typing import Any

ENVIRONMENTS: dict[str, dict[str, Any]] = {  # id -> arguments of make_lane_keeping
    "duckpilot/LaneKeeping-v0": {},
    "duckpilot/LaneKeepingInner-v0": {"lane": "inner"},
    "duckpilot/LaneKeepingRandomised-v0": {"look": "randomised"},
}

if importlib.util.find_spec("gymnasium"):
    import gymnasium

    for _id, _arguments in ENVIRONMENTS.items():
        gymnasium.register(_id, "sim_pybullet.env:make_lane_keeping", kwargs=_arguments)
