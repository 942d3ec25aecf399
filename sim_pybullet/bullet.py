"""The only module that imports PyBullet, which has one client for each who uses it.

Lengths in metres, angles in radians, in the client's own frame; z is up.
"""

import os
import weakref
from functools import partial
from typing import Any

_stderr, _nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
os.dup2(_nowhere, 2)  # it announces its build time
try:
    import pybullet
finally:
    os.dup2(_stderr, 2)
    os.close(_nowhere)
    os.close(_stderr)


class Client:
    """PyBullet's functions, bound to a client of their own that ends with this object."""

    def __init__(self) -> None:
        self.number: int = pybullet.connect(pybullet.DIRECT)
        self.close = weakref.finalize(self, pybullet.disconnect, self.number)

    def __getattr__(self, name: str) -> Any:
        return partial(getattr(pybullet, name), physicsClientId=self.number)
