"""``report --live``: the report's page, served while its runs go on."""

import time
from collections.abc import Sequence
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Lock

from robot.errors import ConfigError
from trainer.report.page import write_report

HOST = "127.0.0.1"
PAUSE_S = 5.0  # between two drawings of the page, which cost the training time
WATCHED = ("*.csv", "*.pt", "*.json", "*.mp4", "config.yaml")


class LiveReport(ThreadingHTTPServer):
    """Serves the page of `write_report` at ``address``; ``serve_forever`` it. Port 0 is a free one.

    ConfigError if there are no runs, or the port is taken.
    """

    daemon_threads = True

    def __init__(self, paths: Sequence[Path], out: Path, port: int) -> None:
        self._paths, self._out, self._lock = paths, out, Lock()
        self._stamp, self._drawn_s = "", -PAUSE_S
        self.news()
        try:
            super().__init__((HOST, port), _Handler)
        except OSError as error:
            raise ConfigError(
                f"--port {port}: expected a free one, got: {error.strerror}"
            ) from error
        self.address = f"http://localhost:{self.server_port}/"

    def news(self) -> tuple[bytes, bytes]:
        """The page, and a stamp that changes with it: drawn anew when its runs have news."""
        with self._lock:
            files = {f for path in self._paths for kind in WATCHED for f in path.rglob(kind)}
            changed = [file.stat().st_mtime_ns for file in files if file.exists()]
            newest = f"{len(changed)}-{max(changed, default=0)}"
            if newest != self._stamp and time.monotonic() - self._drawn_s >= PAUSE_S:
                self._page = write_report(self._paths, self._out, live=True)
                self._stamp, self._drawn_s = newest, time.monotonic()
            return self._page.read_bytes(), self._stamp.encode()


class _Handler(BaseHTTPRequestHandler):
    """``/`` is the page, ``/stamp`` changes with it."""

    server: LiveReport

    def do_GET(self) -> None:
        """Answer one request."""
        kinds = {"/": "html", "/stamp": "plain"}
        if self.path not in kinds:
            self.send_error(404)
            return
        body = self.server.news()[list(kinds).index(self.path)]
        self.send_response(200)
        self.send_header("Content-Type", f"text/{kinds[self.path]}; charset=utf-8")
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, *_: object) -> None:
        """Say nothing: a page asks every few seconds."""
