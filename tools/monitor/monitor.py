"""The monitor without its page: links to robot and localizer, state, recording, commands.

What it knows is the newest of every stream, how old that is, and what happened: `MonitorState`.
"""

import asyncio
import math
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from robot.contract import Stick
from robot.link.command_client import CommandClient
from robot.link.freshness import StreamGate
from robot.link.messages import (
    UNSENT,
    Ack,
    FrameMessage,
    InputAge,
    Mission,
    PoseMessage,
    PosesMessage,
    Telemetry,
    told_age,
)
from robot.link.sockets import LinkConfig, Subscriber
from robot.safety.gates import SafetyLimits
from tools.monitor.attention import AttentionThread, Explained
from tools.monitor.drives import DriveRecorder

SILENT_S = 1.0
LIMITS_S = {"telemetry": SILENT_S, "picture": 0.5, "localizer": 0.5, "answers": 1.0}
LOG_LENGTH = 200
LEVEL_OF_STATE = {"HOLD": "warn", "FAULT": "bad"}
LEVEL_OF_PHASE = {"driving": "info", "failed": "bad", "stopped": "warn", "arrived": "good"}


@dataclass(frozen=True)
class LogEntry:
    """One line of the log; numbered, so that a page asks for what it has not seen."""

    number: int
    t_unix_s: float
    level: str  # info, good, warn, bad, or refused: the page shows it until it is read
    text: str


@dataclass(frozen=True)
class Snapshot:
    """What the page shows. Ages are those of this moment."""

    robot: Telemetry | None
    silent: bool
    silence_s: float | None  # None: never heard
    overhead: PoseMessage | None  # the newest position by the localizer
    heard: tuple[InputAge, ...]  # what reaches this monitor
    drives: int  # changes when a drive was recorded


class MonitorState:
    """Takes messages, refuses stale or doubled ones, keeps the log. ``wall`` is since 1970 [s]."""

    def __init__(self, clock: Callable[[], float], wall: Callable[[], float]) -> None:
        self.telemetry: Telemetry | None = None
        self.frame: FrameMessage | None = None
        self.pose: PoseMessage | None = None
        self.drives = 0
        self._clock = clock
        self._wall = wall
        self._gates = {name: StreamGate() for name in ("telemetry", "picture", "localizer")}
        self._log: deque[LogEntry] = deque(maxlen=LOG_LENGTH)
        self._silent = True

    def take_telemetry(self, message: Telemetry) -> bool:
        """Whether the report is new."""
        if new := self._passes("telemetry", message):
            self._log_changes(self.telemetry, message)
            self.telemetry = message
        return new

    def take_frame(self, message: FrameMessage) -> bool:
        """Whether the picture is new."""
        if new := self._passes("picture", message):
            self.frame = message
        return new

    def take_poses(self, message: PosesMessage) -> bool:
        """Whether it is new, and tells of the robot that this monitor watches."""
        told = message.of(self.telemetry.robot) if self.telemetry else None
        if told is None or not self._passes("localizer", message):
            return False
        self.pose = told
        return True

    def look(self) -> None:
        """Notice silence; call often."""
        silent = self._age("telemetry") > SILENT_S
        if silent and not self._silent:
            state = self.telemetry.state if self.telemetry else "unknown"
            self.note("bad", f"the robot is silent; last heard in {state}")
        if self._silent and not silent:
            self.note("info", "the robot is heard")
        self._silent = silent

    def note(self, level: str, text: str) -> None:
        """Write a line into the log."""
        number = self._log[-1].number + 1 if self._log else 1
        self._log.append(LogEntry(number, self._wall(), level, text))

    def note_answer(self, what: str, ack: Ack) -> None:
        """Log what the robot made of a command."""
        level, why = ("info", "") if ack.accepted else ("refused", f": {ack.reason}")
        self.note(level, f"{what}{why}")

    def log_after(self, number: int) -> tuple[LogEntry, ...]:
        """The lines since that number, oldest first."""
        return tuple(entry for entry in self._log if entry.number > number)

    def snapshot(self, answers_age_s: float) -> Snapshot:
        """What to show; ``answers_age_s`` since the robot last answered a command or beat."""
        self.look()
        ages = {name: self._age(name) for name in self._gates}
        ages["answers"] = answers_age_s
        heard = tuple(InputAge(each, told_age(ages[each]), most) for each, most in LIMITS_S.items())
        return Snapshot(
            robot=self.telemetry,
            silent=self._silent,
            silence_s=told_age(ages["telemetry"]),
            overhead=self.pose,
            heard=heard,
            drives=self.drives,
        )

    def _passes(self, stream: str, message: Telemetry | FrameMessage | PosesMessage) -> bool:
        gate, now_s = self._gates[stream], self._clock()
        reason = gate.problem(message.session, message.sequence, now_s)
        if reason:
            if gate.refused[reason] == 0:
                self.note("warn", f"{stream}: {reason}")
            gate.refused[reason] += 1
            return False
        gate.take(message.sequence, message.t_sent_s, now_s)
        return True

    def _age(self, stream: str) -> float:
        return self._gates[stream].age_s(self._clock())

    def _log_changes(self, before: Telemetry | None, now: Telemetry) -> None:
        if before is None or before.state != now.state:
            reason = f": {now.reason}" if now.reason else ""
            self.note(LEVEL_OF_STATE.get(now.state, "info"), f"{now.state}{reason}")
        old, new = (before.mission if before else None), now.mission
        if new is None or (old is not None and (old.id, old.phase) == (new.id, new.phase)):
            return
        x_m, y_m = new.destination
        told = f": {new.remaining_m:.1f} m to drive"
        if new.phase != "driving":
            told = f" {new.phase}" + (f": {new.reason}" if new.reason else "")
        self.note(LEVEL_OF_PHASE[new.phase], f"mission to ({x_m:.2f}, {y_m:.2f}) m{told}")


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
        self._halts = 0  # asked for: who was asked to go before one may not go after it
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
        self._halts += kind in ("stop", "disarm")
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
            halts = self._halts
            asked = await self.command("plan", mission)
            if halts != self._halts:  # of a robot that stands the robot itself remembers no stop
                return Ack(asked.id, False, "stopped before it was armed")
            if not asked.accepted:
                return asked
            answer = await self.command("arm")
            armed = answer.accepted
            if not armed:
                await asyncio.sleep(NEWS_S)  # armed just before, its report may be on the way
                if self.state.telemetry is None or self.state.telemetry.state not in ARMED:
                    return answer
        answer = await self.command("mission", mission)
        if armed and not answer.accepted:
            await self.command("disarm")
        return answer

    def drive_by_hand(self, page: object, stick: Stick | None) -> bool:
        """Pass on a manual command, for ``HAND_S``, never repeated; False: another page drives."""
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
        """A page is gone: whoever drove with it drives no longer."""
        self._seen_s.pop(page, None)
        if self._hand is not None and self._hand[0] is page:
            self.drive_by_hand(page, None)

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
