"""The command of the monitor, and its options; imports nothing heavy."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from robot.errors import ConfigError


@dataclass(frozen=True)
class MonitorOptions:
    """Whom the page shows, and where."""

    link: Path | None = None  # YAML with keys, robot_host, localizer_host.
    demo: bool = False  # A robot on virtual hardware instead.
    host: str = "127.0.0.1"  # Where to listen; 0.0.0.0: everywhere.
    port: int = 8600  # Of the page.
    map: str = "town"  # A map file or the name of a shipped map.
    drives: Path = Path("runs/drives")  # Recordings.
    model: Path | None = None  # The robot's policy: shows where it looks.


def monitor_command(
    options: Annotated[MonitorOptions, tyro.conf.arg(name="")] = MonitorOptions(),
) -> int:
    """Serve the operator's page until interrupted.

    Args:
        options: whom the page shows, and where.
    """
    from tools.monitor.__main__ import serve

    if (options.link is None) is not options.demo:
        given = "both" if options.demo else "none"
        raise ConfigError(f"expected either --link FILE or --demo, got {given}")
    serve(options)
    return 0
