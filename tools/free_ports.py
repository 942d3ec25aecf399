"""Ports for programs that meet on one computer."""

from __future__ import annotations

import socket
from contextlib import ExitStack


def free_ports(count: int) -> int:
    """The first of ``count`` free ports in a row.

    Raises:
        OSError: none were found.
    """
    for _ in range(100):
        with ExitStack() as stack:
            first = stack.enter_context(socket.socket())
            first.bind(("127.0.0.1", 0))
            base = int(first.getsockname()[1])
            if base + count > 65535:
                continue
            try:
                for offset in range(1, count):
                    other = stack.enter_context(socket.socket())
                    other.bind(("127.0.0.1", base + offset))
            except OSError:
                continue
            return base
    raise OSError(f"expected {count} free ports in a row, found none")
