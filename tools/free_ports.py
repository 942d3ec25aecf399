"""Ports for programs that meet on one computer."""

from __future__ import annotations

import contextlib
import socket


def free_ports(count: int) -> int:
    """The first of ``count`` free ports in a row; OSError when none are found."""
    for _ in range(100):
        with contextlib.ExitStack() as stack, contextlib.suppress(OSError, OverflowError):
            base = 0
            for offset in range(count):
                listener = stack.enter_context(socket.socket())
                listener.bind(("127.0.0.1", base + offset if base else 0))
                base = base or int(listener.getsockname()[1])
            return base
    raise OSError(f"expected {count} free ports in a row, found none")
