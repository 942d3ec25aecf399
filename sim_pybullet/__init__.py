"""The simulated world: PyBullet bodies, fisheye cameras, looks, tasks and virtual hardware.

Importing it registers the environments with Gymnasium, by name only: what they need is imported
when one is made. Where Gymnasium is absent (the robot's own tests need only the virtual hardware)
nothing is registered.
"""

from __future__ import annotations

import importlib.util
from typing import Any

from robot.command_line import tell_of_imports

tell_of_imports("sim_pybullet")

ENVIRONMENTS: dict[str, tuple[str, dict[str, Any]]] = {  # id -> maker and its arguments
    "duckpilot/LaneKeeping-v0": ("make_lane_keeping", {}),
    "duckpilot/LaneKeepingInner-v0": ("make_lane_keeping", {"lane": "inner"}),
    "duckpilot/LaneKeepingRandomised-v0": ("make_lane_keeping", {"look": "randomised"}),
    "duckpilot/Navigation-v0": ("make_navigation", {}),
    "duckpilot/NavigationArenaPose-v0": ("make_navigation", {"pose_error": "arena"}),
    "duckpilot/TrackRacing-v0": ("make_track_racing", {}),
    "duckpilot/TrackRacingLooks-v0": ("make_track_racing", {"look": "tracks"}),
}

if importlib.util.find_spec("gymnasium"):
    import gymnasium

    for _id, (_maker, _arguments) in ENVIRONMENTS.items():
        gymnasium.register(_id, f"sim_pybullet.env:{_maker}", kwargs=_arguments)
