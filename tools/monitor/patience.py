"""The page's server does not wait for ever for those who connect and ask for nothing.

uvicorn closes a connection that is idle after a request, but waits without end for the first one,
and for one that came in part. Each costs a descriptor.
"""

from __future__ import annotations

import asyncio
from typing import Any

from uvicorn.protocols.http.auto import AutoHTTPProtocol

WAIT_S = 5.0  # for a whole request; looked at so often

_Protocol: Any = AutoHTTPProtocol  # which one it is depends on what is installed


class ImpatientProtocol(_Protocol):
    """As uvicorn's own, but a connection without a new request for ``WAIT_S`` to twice that ends.

    One that was upgraded to a WebSocket, or whose answer is under way, stays.
    """

    def connection_made(self, transport: asyncio.Transport) -> None:
        """Begin to wait."""
        super().connection_made(transport)
        self._answered: Any = None
        self._look_again()

    def connection_lost(self, exc: Exception | None) -> None:
        """Wait no longer."""
        self._timer.cancel()
        super().connection_lost(exc)

    def _look_again(self) -> None:
        self._timer = asyncio.get_running_loop().call_later(WAIT_S, self._look)

    def _look(self) -> None:
        if self.transport.is_closing() or self.transport.get_protocol() is not self:
            return
        answering = self.cycle is not None and not self.cycle.response_complete
        if not answering and self.cycle is self._answered:
            self.transport.close()
            return
        self._answered = self.cycle
        self._look_again()
