"""Who speaks and who listens on which stream. The only place that says so.

| stream | bound by | port | who may connect |
|---|---|---|---|
| pose | localizer | base_port | robot, monitor: they listen |
| telemetry | robot | base_port + 1 | monitor: it listens |
| frame | robot | base_port + 2 | monitor: it listens |
| command | robot | base_port + 3 | monitor: it commands |
"""

from __future__ import annotations

from typing import Dict, Tuple

ROLES = ("robot", "localizer", "monitor")
BOUND_BY: Dict[str, str] = {
    "pose": "localizer",
    "telemetry": "robot",
    "frame": "robot",
    "command": "robot",
}
ADMITS: Dict[str, Tuple[str, ...]] = {
    "pose": ("robot", "monitor"),
    "telemetry": ("monitor",),
    "frame": ("monitor",),
    "command": ("monitor",),
}
