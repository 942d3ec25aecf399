"""What the monitor knows: the newest of every stream, how old it is, and what happened.

Pure: messages and a clock in, snapshots for the page out.
"""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from robot.link.freshness import StreamGate
from robot.link.messages import (
    Ack,
    FrameMessage,
    InputAge,
    PoseMessage,
    PosesMessage,
    Telemetry,
    told_age,
)

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
        if ack.accepted:
            self.note("info", what)
        else:
            self.note("refused", f"{what}: {ack.reason}")

    def log_after(self, number: int) -> tuple[LogEntry, ...]:
        """The lines since that number, oldest first."""
        return tuple(entry for entry in self._log if entry.number > number)

    def snapshot(self, answers_age_s: float) -> Snapshot:
        """What to show; ``answers_age_s`` since the robot last answered a command or beat."""
        self.look()
        ages = {name: self._age(name) for name in self._gates}
        ages["answers"] = answers_age_s
        heard = tuple(
            InputAge(name, told_age(ages[name]), limit_s) for name, limit_s in LIMITS_S.items()
        )
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
