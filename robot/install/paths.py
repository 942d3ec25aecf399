"""Where an installation puts things."""

from __future__ import annotations

PREFIX = "/opt/duckpilot"
VENV = f"{PREFIX}/venv"
MODEL = f"{PREFIX}/lane.onnx"
ETC = "/etc/duckpilot"
KEYS = f"{ETC}/keys"
CONFIG = f"{ETC}/robot.yaml"
STATE = "/var/lib/duckpilot"
MANIFEST = "/var/lib/duckpilot-installed.json"  # what was done, so that it can be undone
UDEV_RULE = "/etc/udev/rules.d/99-duckpilot-i2c.rules"
UNIT = "duckpilot-robot.service"
UNIT_FILE = f"/etc/systemd/system/{UNIT}"
USER = "duckpilot"
GROUPS = ("i2c", "video", "gpio")
