"""The command of the monitor, and its options; imports nothing heavy."""

import secrets
import signal
import socket
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from robot.errors import ConfigError
from robot.link.sockets import LinkConfig
from robot.navigation.road_map import load_map
from robot.output import expect_folder
from robot.typed_config import load_yaml
from tools.monitor import LOOPBACK_NAMES

WS_LIMIT_BYTES = 4096  # of one message from a page; its longest has 15
WS_QUEUE = 8


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
    """Serve the operator's page until interrupted."""
    if (options.link is None) is not options.demo:
        given = "both" if options.demo else "none"
        raise ConfigError(f"expected either --link FILE or --demo, got {given}")
    import uvicorn

    from tools.monitor.app import create_app
    from tools.monitor.monitor import Monitor

    signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))
    road_map = load_map(options.map)
    expect_folder(options.drives)
    listening = _listening(options.host, options.port)
    if options.demo:
        from tools.monitor.demo import show

        listening.close()
        show(options)
        return 0
    assert options.link is not None
    config = load_yaml(LinkConfig, options.link)
    token = secrets.token_urlsafe(16)
    app = create_app(Monitor(config, options.drives, options.model), road_map, token, options.host)
    shown = "localhost" if options.host in LOOPBACK_NAMES else options.host
    print(f"Open http://{shown}:{options.port}/?token={token}", flush=True)
    if options.host not in LOOPBACK_NAMES:
        print("This page is not encrypted: use it on a network you trust.", flush=True)
    server = uvicorn.Config(app, log_level="warning", ws_max_size=WS_LIMIT_BYTES)
    server.ws_max_queue = WS_QUEUE
    uvicorn.Server(server).run([listening])
    return 0


def _listening(host: str, port: int) -> socket.socket:
    """A socket that is bound, which a second program's cannot be; ConfigError if it cannot."""
    try:
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        return socket.create_server((host, port), family=family)
    except (OSError, UnicodeError) as error:
        told = getattr(error, "strerror", None) or str(error)
        raise ConfigError(
            f"--host {host} --port {port}: expected an address of this computer and a free port, "
            f"got: {told}"
        ) from error
