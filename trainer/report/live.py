"""``report --live``: the report's page, served while its runs go on."""

from __future__ import annotations

import time
from collections.abc import Sequence
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Lock

from robot.errors import ConfigError
from trainer.report.page import PAGE, write_report

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
        self._draw(self._newest())
        try:
            super().__init__((HOST, port), _Handler)
        except OSError as error:
            raise ConfigError(
                f"--port {port}: expected a free one, got: {error.strerror}"
            ) from error
        self.address = f"http://localhost:{self.server_port}/"

    def stamp(self) -> bytes:
        """Another one after the page has changed; draws it anew when its runs have news."""
        with self._lock:
            newest = self._newest()
            if newest != self._stamp and time.monotonic() - self._drawn_s >= PAUSE_S:
                self._draw(newest)
            return self._stamp.encode()

    def page(self) -> bytes:
        """The newest page."""
        self.stamp()
        return (self._out / PAGE).read_bytes()

    def _draw(self, newest: str) -> None:
        write_report(self._paths, self._out, live=True)
        self._stamp, self._drawn_s = newest, time.monotonic()

    def _newest(self) -> str:
        files = {f for path in self._paths for kind in WATCHED for f in path.rglob(kind)}
        changed = [file.stat().st_mtime_ns for file in files if file.exists()]
        return f"{len(changed)}-{max(changed, default=0)}"


class _Handler(BaseHTTPRequestHandler):
    """``/`` is the page, ``/stamp`` changes with it."""

    server: LiveReport

    def do_GET(self) -> None:
        """Answer one request."""
        found = {"/": (self.server.page, "html"), "/stamp": (self.server.stamp, "plain")}
        if self.path not in found:
            self.send_error(404)
            return
        answer, kind = found[self.path]
        body = answer()
        self.send_response(200)
        self.send_header("Content-Type", f"text/{kind}; charset=utf-8")
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, *_: object) -> None:
        """Say nothing: a page asks every few seconds."""
