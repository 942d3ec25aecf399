"""What robots are asked to do: a task is one file here, found by lying here.

It keeps `sim_pybullet.tasks.spec.Task` and registers a `sim_pybullet.tasks.spec.TaskSpec`.
"""

import importlib
import pkgutil

for _found in pkgutil.iter_modules(__path__):
    importlib.import_module(f"{__name__}.{_found.name}")
