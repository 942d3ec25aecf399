"""The robot as a service of systemd: the files that an installation writes, and where."""

from __future__ import annotations

PREFIX = "/opt/duckpilot"
VENV = f"{PREFIX}/venv"
MODEL = f"{PREFIX}/lane.onnx"
ETC = "/etc/duckpilot"
KEYS = f"{ETC}/keys"
CONFIG = f"{ETC}/robot.yaml"
STATE = "/var/lib/duckpilot"
UDEV_RULE = "/etc/udev/rules.d/99-duckpilot-i2c.rules"
UNIT = "duckpilot-robot.service"
UNIT_FILE = f"/etc/systemd/system/{UNIT}"
USER = "duckpilot"
GROUPS = ("i2c", "video", "gpio")


UDEV = """\
# duckpilot: the group i2c may use the buses, as the robot's motor HAT needs it.
SUBSYSTEM=="i2c-dev", GROUP="i2c", MODE="0660"
"""


def unit_text(groups: str) -> str:
    """The systemd unit; ``groups`` separated by spaces.

    The robot boots DISARMED, so a restart never drives. WatchdogSec kills a loop that hangs; what
    runs after every end, however it came, switches the motors off.
    """
    python = f"{VENV}/bin/python"
    return f"""\
# {UNIT}: written by `python -m robot install`.
[Unit]
Description=duckpilot robot (boots DISARMED; a person arms it)
After=network-online.target nvargus-daemon.service
Wants=network-online.target
StartLimitIntervalSec=60
StartLimitBurst=5

[Service]
Type=notify
User={USER}
SupplementaryGroups={groups}
WorkingDirectory={STATE}
Environment=PYTHONUNBUFFERED=1
ExecStart={python} -m robot drive --config {CONFIG}
ExecStopPost={python} -m robot off --config {CONFIG}
TimeoutStopSec=5
WatchdogSec=2
Restart=on-failure
RestartSec=3
# 2 is wrong input: a person has to mend it first.
RestartPreventExitStatus=2
Nice=-5
LimitCORE=0
MemoryMax=512M
NoNewPrivileges=yes
ProtectSystem=strict
ProtectHome=yes
ReadWritePaths={STATE}

[Install]
WantedBy=multi-user.target
"""


def config_text(model: str) -> str:
    """The first configuration: what a person must look at; everything else has a default."""
    return f"""\
# The robot. docs/runtime.md describes every section; `python -m robot doctor --config {CONFIG}`
# says what is wrong with it.
model: {model}
name: robot
camera: {{kind: csi}}
hat: {{steps_per_rev: 48, left: {{port: M1M2}}, right: {{port: M3M4, reversed: true}}}}
safety: {{max_wheel_mps: 0.2}}
recording: {{folder: {STATE}/drives}}
# For a monitor and a localizer, after `python -m robot keygen`:
# map: town
# link: {{keys: /etc/duckpilot/keys/robot, localizer_host: 192.168.1.11}}
"""
