"""``--demo``: the page on the loop bench, in lock-step, as fast as the wall clock where it can."""

import tempfile
import time
from pathlib import Path

from robot.errors import ConfigError
from tools.loop.bench import PROGRAMS, Bench, BenchOptions
from tools.loop.cli import NAVIGATOR
from tools.monitor.cli import MonitorOptions

TURN_S = 0.02
PATIENCE_S = 60.0


def show(arguments: MonitorOptions) -> None:
    """Let the virtual world live as long as the page's program does; ConfigError: wrong input."""
    page = ["--host", arguments.host, "--port", str(arguments.port)]
    page += ["--drives", str(arguments.drives), "--model", str(arguments.model or NAVIGATOR)]
    options = BenchOptions(NAVIGATOR, arguments.map, page=tuple(page))
    with tempfile.TemporaryDirectory(prefix="duckpilot-demo-") as folder:
        bench = Bench(options, Path(folder))
        bench.town.world.place(bench.road_map.lanes[0].pose_at(0.5))
        try:
            monitor = bench.start("monitor")
            told = lambda: "?token=" in monitor.said() or not monitor.alive  # noqa: E731
            bench.until(told, PATIENCE_S, "an address", TURN_S)
            if not monitor.alive:
                raise ConfigError(monitor.said().strip().rpartition("monitor: ")[2])
            print(monitor.said().strip(), flush=True)
            for name in PROGRAMS.keys() - {"monitor"}:
                bench.start(name)
            while monitor.alive:
                began_s = time.monotonic()
                bench.time.run_until(bench.now_s + TURN_S)
                time.sleep(max(0.0, began_s + TURN_S - time.monotonic()))
        finally:
            bench.close()
