"""The simulated world: PyBullet bodies, fisheye cameras, looks, tasks and virtual hardware.

Importing it registers the tasks' environments with Gymnasium by name, where there is Gymnasium.
"""

import importlib.util

if importlib.util.find_spec("gymnasium"):
    import sim_pybullet.tasks  # noqa: F401
