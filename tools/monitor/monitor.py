"""The monitor without its page: links to robot and localizer, state, recording, commands."""

import asyncio
import math
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path

from robot.contract import Stick
from robot.link.command_client import CommandClient
from robot.link.messages import UNSENT, Ack, FrameMessage, Mission, PosesMessage, Telemetry
from robot.link.sockets import LinkConfig, Subscriber
from robot.safety.gates import SafetyLimits
from tools.monitor.attention import AttentionThread, Explained
from tools.monitor.drives import DriveRecorder
from tools.monitor.state import MonitorState, Snapshot

TURN_S = 0.02
PATIENCE_S = 1.5
NEWS_S = 0.25  # a change of the robot's state is reported within this
ARMED = ("READY", "MANUAL", "AUTO")
HAND_S = SafetyLimits.manual_age_s  # after its last manual command a page drives no longer
PAGE_ALIVE_S = 1.0  # a page that showed nothing new for so long is no watcher


class Monitor:
    """Everything but the web server; ``run`` it in an event loop, then ``close``.

    It beats to the robot only while a page is open and showing what is sent: when the last page is
    closed or hangs, the robot learns that its operator is gone, and stops.
    """

    def __init__(self, config: LinkConfig, drives: Path, model: Path | None = None) -> None:
        self.state = MonitorState(time.monotonic, time.time)
        self.drives = drives
        self._attention = AttentionThread(model) if model is not None else None
        self._link = config.open()
        self._telemetry = Subscriber(self._link, Telemetry)
        self._frames = Subscriber(self._link, FrameMessage)
        self._poses = Subscriber(self._link, PosesMessage)
        self._client = CommandClient(self._link)
        self._recorder: DriveRecorder | None = DriveRecorder(drives, time.time)
        self._waiting: dict[str, tuple[str, asyncio.Future[Ack]]] = {}  # what was asked
        self._hand: tuple[object, float] | None = None  # the page that drives, and until when
        self._by_hand: deque[str] = deque(maxlen=64)
        self._hand_refusal = ""
        self._seen_s: dict[object, float] = {}

    async def run(self) -> None:
        """Turn until cancelled."""
        while True:
            self.turn()
            await asyncio.sleep(TURN_S)

    def turn(self) -> None:
        """Read every stream and the answers to commands; never blocks."""
        telemetry = self._telemetry.receive()
        if telemetry is not None:
            report = telemetry
            if self._attention is not None:
                report = Explained(**vars(telemetry), attention=self._attention.newest)
            if self.state.take_telemetry(report):
                self._record(lambda recorder: recorder.take(report))
        frame = self._frames.receive()
        if frame is not None and self.state.take_frame(frame):
            self._record(lambda recorder: recorder.take_frame(frame))
            if self._attention is not None:
                self._attention.offer(frame)
        poses = self._poses.receive()
        if poses is not None:
            self.state.take_poses(poses)
        for ack in self._client.poll(beat=self.watched):
            self._answered(ack)
        self.state.look()

    async def command(self, kind: str, mission: Mission | None = None) -> Ack:
        """Ask the robot; returns its answer, or a refusal when it does not answer in time."""
        command_id = self._client.send(kind, mission)
        new = (_what(kind, mission), asyncio.get_running_loop().create_future())
        _, future = self._waiting.setdefault(command_id, new)
        try:
            return await asyncio.wait_for(asyncio.shield(future), PATIENCE_S)
        except TimeoutError:
            return Ack(command_id, False, "no answer yet; STOP is repeated until there is one")

    async def drive(self, mission: Mission, arm: bool) -> Ack:
        """Send on a mission; the robot's answer.

        With ``arm`` a robot that stands unarmed is asked whether it would go, then armed, then
        sent: a mission that is refused leaves it as it was.
        """
        armed = False
        if arm:
            asked = await self.command("plan", mission)
            if not asked.accepted:
                return asked
            answer = await self.command("arm")
            armed = answer.accepted
            if not armed and not await self._turns_out_armed():
                return answer
        answer = await self.command("mission", mission)
        if armed and not answer.accepted:
            await self.command("disarm")
        return answer

    async def _turns_out_armed(self) -> bool:
        """Whether the robot was armed just before; its report may be on the way."""
        await asyncio.sleep(NEWS_S)
        return self.state.telemetry is not None and self.state.telemetry.state in ARMED

    def drive_by_hand(self, page: object, stick: Stick | None) -> bool:
        """Pass on one manual command: it holds for ``HAND_S`` and is never repeated.

        False while another page drives.
        """
        now_s = time.monotonic()
        if self._hand is not None and self._hand[0] is not page and now_s < self._hand[1]:
            return False
        self._hand = None if stick is None else (page, now_s + HAND_S)
        wheels = None if stick is None else stick.wheels
        self._by_hand.append(self._client.send("manual", wheels=wheels))
        return True

    def snapshot(self) -> Snapshot:
        """What the page shows now."""
        return self.state.snapshot(self._client.silence_s())

    def page_showed(self, page: object) -> None:
        """A page has shown what it was sent."""
        self._seen_s[page] = time.monotonic()

    def page_closed(self, page: object) -> None:
        """A page is gone."""
        self._seen_s.pop(page, None)

    @property
    def watched(self) -> bool:
        """Whether somebody has the page open."""
        return time.monotonic() - max(self._seen_s.values(), default=-math.inf) < PAGE_ALIVE_S

    def close(self) -> None:
        """Complete the recording and close the links."""
        self._record(DriveRecorder.close)
        self._link.close()

    def _record(self, work: Callable[[DriveRecorder], bool | None]) -> None:
        if self._recorder is None:
            return
        try:
            self.state.drives += bool(work(self._recorder))
        except OSError as error:
            self.state.note("bad", f"drives are no longer recorded: {error.strerror}")
            self._recorder = None

    def _answered(self, ack: Ack) -> None:
        if ack.id in self._by_hand and ack.robot_session != UNSENT:  # the next may be heard
            if not ack.accepted and ack.reason != self._hand_refusal:
                self.state.note_answer("manual", ack)
            self._hand_refusal = ack.reason
        if ack.id in self._waiting:
            what, future = self._waiting.pop(ack.id)
            self.state.note_answer(what, ack)
            future.set_result(ack)


def _what(kind: str, mission: Mission | None) -> str:
    if mission is None:
        return kind
    x_m, y_m = mission.start if kind == "place" and mission.start else mission.destination
    if kind == "place":
        return f"it stands at ({x_m:.2f}, {y_m:.2f}) m"
    return f"{'a way' if kind == 'plan' else 'drive'} to ({x_m:.2f}, {y_m:.2f}) m"
