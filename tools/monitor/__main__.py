"""``python -m tools.monitor``: the operator's page."""

from __future__ import annotations

import secrets
import signal
import socket
import sys
from functools import partial
from typing import TYPE_CHECKING

from robot.errors import ConfigError
from robot.link.sockets import LinkConfig
from robot.navigation.road_map import load_map
from robot.output import expect_folder
from robot.typed_config import load_yaml
from tools.monitor import LOOPBACK_NAMES
from trainer.cli import Command, run

if TYPE_CHECKING:
    from tools.monitor.cli import MonitorOptions

WS_LIMIT_BYTES = 4096  # of one message from a page; its longest has 15
WS_QUEUE = 8
COMMAND = Command("tools.monitor.cli:monitor_command", "the operator's page in the browser")
main = partial(run, COMMAND, prog="python -m tools.monitor")


def serve(arguments: MonitorOptions) -> None:
    """Run the server until interrupted; ConfigError, before it says where: wrong input."""
    import uvicorn

    from tools.monitor.app import create_app
    from tools.monitor.monitor import Monitor

    signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))
    road_map = load_map(arguments.map)
    expect_folder(arguments.drives)
    listening = _listening(arguments.host, arguments.port)
    if arguments.demo:
        from tools.monitor.demo import show

        listening.close()
        show(arguments)
        return
    assert arguments.link is not None
    config = load_yaml(LinkConfig, arguments.link)
    token = secrets.token_urlsafe(16)
    monitor = Monitor(config, arguments.drives, arguments.model)
    app = create_app(monitor, road_map, token, arguments.host)
    shown = "localhost" if arguments.host in LOOPBACK_NAMES else arguments.host
    print(f"Open http://{shown}:{arguments.port}/?token={token}", flush=True)
    if arguments.host not in LOOPBACK_NAMES:
        print("This page is not encrypted: use it on a network you trust.", flush=True)
    server = uvicorn.Config(app, log_level="warning", ws_max_size=WS_LIMIT_BYTES)
    server.ws_max_queue = WS_QUEUE
    uvicorn.Server(server).run([listening])


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


if __name__ == "__main__":
    raise SystemExit(main())
