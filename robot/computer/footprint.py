"""How long the runtime takes to import and how much memory it holds, in a process of its own."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Union

ROOT = Path(__file__).resolve().parents[2]
TURNS = 50  # driven before memory is read


@dataclass(frozen=True)
class Footprint:
    """Seconds to import every module of ``robot``; greatest resident memory while driving [MB]."""

    import_s: float
    rss_mb: float


def measure_footprint(model: Union[str, Path]) -> Footprint:
    """Start a fresh Python that imports everything and drives with a policy.

    ContractError where the model keeps no contract.
    """
    from robot.inference.policy import OnnxPolicy

    OnnxPolicy(model)
    path = os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH"))))
    done = subprocess.run(
        [sys.executable, "-m", "robot.computer.footprint", str(model)],
        check=True,
        stdout=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": path},
    )
    return Footprint(**json.loads(done.stdout))


def _measure_here(model: str) -> Footprint:
    import importlib
    import pkgutil
    import time

    import robot

    began_s = time.perf_counter()
    for module in pkgutil.walk_packages(robot.__path__, "robot."):
        if not module.name.endswith("__main__"):
            importlib.import_module(module.name)
    import_s = time.perf_counter() - began_s
    from robot.runtime.dry_run import dry_runtime

    runtime = dry_runtime(Path(model))
    for _ in range(TURNS):
        runtime.step()
    # Not from getrusage: its peak is inherited from the parent.
    status = Path("/proc/self/status").read_text(encoding="ascii").split()
    return Footprint(import_s, int(status[status.index("VmHWM:") + 1]) / 1024.0)


if __name__ == "__main__":
    print(json.dumps(asdict(_measure_here(sys.argv[1]))))
