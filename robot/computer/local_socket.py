"""Unix sockets to virtual hardware in another process."""

import errno
import socket

from robot.errors import HardwareError


def connect_local(path: str, what: str, silence_s: float) -> socket.socket:
    """To ``what`` at ``path``, ``silence_s`` [s] for each call; HardwareError: nobody listens."""
    connection = socket.socket(socket.AF_UNIX)
    connection.settimeout(silence_s)
    try:
        connection.connect(path)
    except OSError as error:
        connection.close()
        told = f"{path}: expected {what}, got: {error.strerror or error}; "
        raise HardwareError(f"{told}start the virtual hardware first (duckpilot loop)") from error
    return connection


def receive_exactly(source: socket.socket, count: int) -> bytes:
    """``count`` bytes; OSError when they do not come."""
    data = bytearray(count)
    rest = memoryview(data)
    while rest:
        got = source.recv_into(rest)
        if not got:
            raise OSError(errno.EPIPE, "the other side has hung up")
        rest = rest[got:]
    return bytes(data)
