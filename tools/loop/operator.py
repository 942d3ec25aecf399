"""The person at the monitor's page, as a program: logs in, watches, arms, sends on missions.

Speaks HTTP and WebSocket to the monitor as a browser does. One thread and no timers: in lock-step
everything that it sends is worked through before time goes on.
"""

import http.client
import json
import math
import re
import select
import socket
from typing import Any

from websockets.client import ClientProtocol
from websockets.frames import Frame, Opcode
from websockets.protocol import State
from websockets.uri import parse_uri

from robot.contract import Stick
from tools.loop.timekeeper import BenchError, Timekeeper

TURN_S = 0.05
ANSWER_S = 5.0
LONGEST_S = 0.25  # real time that what was sent may take


class Operator:
    """One open page of the monitor that listens at ``port``."""

    def __init__(self, time: Timekeeper, port: int, token: str, name: str = "monitor") -> None:
        self.snapshot: dict[str, Any] = {}
        self.picture = b""
        self.watching = True
        self.closed = False  # by the monitor
        self._unseen = 0  # states that we have not said we saw
        self._time, self._port, self._name = time, port, name
        reply = self._request("GET", f"/?token={token}")
        cookie = re.match(r"[^;]+", reply.headers.get("Set-Cookie", ""))
        if reply.status != 200 or cookie is None:
            raise BenchError(f"monitor: expected to be let in, got status {reply.status}")
        self._cookie = cookie.group()
        self._socket = self._open_page()

    @property
    def robot(self) -> dict[str, Any]:
        """The robot's newest report; empty before the first."""
        return self.snapshot.get("robot") or {}

    @property
    def state(self) -> str:
        """The robot's state, as the page shows it."""
        return str(self.robot.get("state", ""))

    @property
    def reason(self) -> str:
        """Why."""
        return str(self.robot.get("reason", ""))

    @property
    def mission(self) -> dict[str, Any]:
        """The mission's status; empty without one."""
        return self.robot.get("mission") or {}

    def age_s(self, name: str) -> float:
        """How old an input of the robot is, as the robot says; infinite when it never came."""
        age_s = {i["name"]: i["age_s"] for i in self.robot.get("inputs", ())}.get(name)
        return math.inf if age_s is None else float(age_s)

    def turn(self) -> None:
        """Let a moment pass, and look at the page."""
        self._time.run_until(self._time.clock.now() + TURN_S)
        self.look()

    def look(self) -> None:
        """Take in all that the page was sent by now, and show that we watch."""
        if opened := not self.closed and self._protocol.state is State.OPEN:
            self._protocol.send_ping(b"")  # its answer comes after all that was sent before
            self._flush()
        while select.select([self._socket], [], [], LONGEST_S * opened)[0]:
            if not (data := self._socket.recv(1 << 20)):
                self.closed = True
                return
            self._protocol.receive_data(data)
            for event in self._protocol.events_received():
                if isinstance(event, Frame) and event.opcode is Opcode.BINARY:
                    self.picture = bytes(event.data)
                elif isinstance(event, Frame) and event.opcode is Opcode.TEXT:
                    self.snapshot = json.loads(bytes(event.data))["state"]
                    self._unseen += 1
                opened = opened and getattr(event, "opcode", None) is not Opcode.PONG
        while self._unseen and self.watching:
            self._protocol.send_text(b"seen")
            self._unseen -= 1
        self._flush()

    def ask(
        self,
        kind: str,
        destination: tuple[float, float] | None = None,
        arm: bool = False,
        start: tuple[float, float] | None = None,
    ) -> tuple[bool, str]:
        """Press a button of the page, with ``arm`` *Arm and drive*; was it accepted, why not."""
        body: dict[str, Any] = {"kind": kind, "arm": arm}
        for name, place in (("destination", destination), ("start", start)):
            if place is not None:
                body[name] = [round(v, 4) for v in place]
        answer = json.loads(self._request("POST", "/api/command", json.dumps(body)).read())
        return bool(answer["accepted"]), str(answer["reason"])

    def steer(self, stick: Stick) -> None:
        """Drive by hand, as a gamepad at the page does."""
        self._protocol.send_text(json.dumps({"manual": [round(v, 4) for v in stick]}).encode())
        self._flush()

    def _open_page(self) -> socket.socket:
        self._protocol = ClientProtocol(parse_uri(f"ws://127.0.0.1:{self._port}/ws"), max_size=None)
        request = self._protocol.connect()
        request.headers["Cookie"] = self._cookie
        request.headers["Origin"] = f"http://127.0.0.1:{self._port}"
        self._protocol.send_request(request)
        page = socket.create_connection(("127.0.0.1", self._port))
        self._send(page, b"".join(self._protocol.data_to_send()))
        return page

    def _request(self, method: str, path: str, body: str = "") -> http.client.HTTPResponse:
        """One request in one piece, and the answer, while time goes on."""
        host = f"127.0.0.1:{self._port}"
        lines = [f"{method} {path} HTTP/1.1", f"Host: {host}", "Connection: close"]
        if body:
            lines += [f"Origin: http://{host}", f"Cookie: {self._cookie}"]
            lines += ["Content-Type: application/json", f"Content-Length: {len(body)}"]
        connection = socket.create_connection(("127.0.0.1", self._port))
        self._send(connection, ("\r\n".join(lines) + "\r\n\r\n" + body).encode())
        deadline_s = self._time.clock.now() + ANSWER_S
        while not select.select([connection], [], [], 0.0)[0]:
            if self._time.clock.now() > deadline_s:
                raise BenchError(f"monitor: no answer to {method} {path}")
            self._time.run_until(self._time.clock.now() + 0.01)
        reply = http.client.HTTPResponse(connection, method=method)
        reply.begin()
        connection.close()
        return reply

    def _flush(self) -> None:
        if data := b"".join(self._protocol.data_to_send()):
            self._send(self._socket, data)

    def _send(self, connection: socket.socket, data: bytes) -> None:
        connection.sendall(data)
        self._time.poked(self._name)
