"""``python -m tools.loop.in_step SOCKET TIME NAME MODULE ...``: a program, unchanged, in lock-step.

Runs ``python -m MODULE ...`` in this process with the time that the conductor gives: monotonic
clocks show it, and whoever waits for a while (``sleep``, ``Condition.wait``, an event loop) waits
for the conductor. Everything else, sockets and keys included, is as it always is. Python 3.8.
"""

from __future__ import annotations

import runpy
import socket
import sys

from tools.loop import patches, wire_watch
from tools.loop.shared_time import SharedTime
from tools.loop.stepper import Stepper


def main() -> None:
    """Join the conductor, put time in its place, and become the program."""
    path, time_path, name, module, *arguments = sys.argv[1:]
    connection = socket.socket(socket.AF_UNIX)
    connection.connect(path)
    connection.sendall(name.encode().ljust(16))
    shared = SharedTime(time_path)
    stepper = Stepper(connection, shared)
    patches.install(stepper)
    patches.slow_down(stepper, shared)
    wire_watch.install(shared)
    stepper.start()
    sys.argv = [module, *arguments]
    runpy.run_module(module, run_name="__main__", alter_sys=True)


if __name__ == "__main__":
    main()
