"""Whether the robot may move: arming, states and what each fault leads to. Pure; no hardware.

The robot boots DISARMED. Only a person's command leads towards motion, and only while every gate
of the state asked for holds. Trouble always leads away from it: to HOLD when the world outside let
the robot down (a late pose, a lost link), to FAULT when the robot itself is in doubt. Neither is
ever left without a person.
"""

from enum import Enum
from typing import Callable, Dict, FrozenSet, NamedTuple, Optional, Tuple

from robot.safety.gates import Inputs, Reason, SafetyLimits, Trip, trips


class State(Enum):
    """What the robot is doing about motion."""

    DISARMED = "DISARMED"  # coils off
    READY = "READY"  # armed, standing
    AUTO = "AUTO"  # the policy drives
    MANUAL = "MANUAL"  # a person drives
    HOLD = "HOLD"  # stopped, coils hold
    FAULT = "FAULT"  # stopped, coils off, until a person clears it


class Command(Enum):
    """What a person can ask for."""

    ARM = "arm"
    AUTO = "auto"
    MANUAL = "manual"
    STOP = "stop"  # the emergency stop: always taken
    DISARM = "disarm"  # always taken
    CLEAR = "clear"  # acknowledge a fault


MOVING: FrozenSet[State] = frozenset((State.AUTO, State.MANUAL))
COILS_OFF: FrozenSet[State] = frozenset((State.DISARMED, State.FAULT))

# Every way that a person's command can take. Nothing else leads to READY, AUTO or MANUAL.
TRANSITIONS: Dict[Tuple[State, Command], State] = {
    (State.DISARMED, Command.ARM): State.READY,
    (State.HOLD, Command.ARM): State.READY,
    (State.READY, Command.AUTO): State.AUTO,
    (State.READY, Command.MANUAL): State.MANUAL,
    (State.AUTO, Command.MANUAL): State.MANUAL,
    (State.MANUAL, Command.AUTO): State.AUTO,
    (State.FAULT, Command.CLEAR): State.DISARMED,
    **{(state, Command.STOP): State.HOLD for state in (State.READY, *MOVING)},
    **{(state, Command.DISARM): State.DISARMED for state in (State.READY, State.HOLD, *MOVING)},
}
ALWAYS_TAKEN: FrozenSet[Command] = frozenset((Command.STOP, Command.DISARM))

_UNKNOWN = frozenset((Reason.POSE_STALE, Reason.POSE_UNSURE))
_ASTRAY = _UNKNOWN | {Reason.OFF_MAP, Reason.OFF_PATH, Reason.NO_MISSION}
_ROBOT = frozenset((Reason.LOOP_LATE, Reason.FRAME_STALE, Reason.FRAME_FROZEN, Reason.LINK_LOST))
_ROUTE = _ASTRAY | frozenset(
    (Reason.DUPLICATE_PUBLISHER, Reason.POSE_JUMP, Reason.POSE_DOUBT, Reason.NOT_MOVING)
)
_PICTURE = frozenset((Reason.PICTURE_BLIND, Reason.PICTURE_WRONG, Reason.PICTURE_STILL))
# The gates of each armed state. A person who drives by hand may bring a lost robot back to its
# path, and sees for it.
WATCHED: Dict[State, FrozenSet[Reason]] = {
    State.READY: _ROBOT,
    State.AUTO: _ROBOT | _ROUTE | _PICTURE | {Reason.NON_FINITE},
    State.MANUAL: _ROBOT | {Reason.MANUAL_STALE},
}
# What grows old between two turns of the loop, too. Frames do not wait here: the next one may have
# come already, and lies unseen until the next turn; a second of poses does not.
GROWS_OLD: FrozenSet[Reason] = frozenset((Reason.LOOP_LATE, Reason.POSE_STALE, Reason.LINK_LOST))
# What comes in the same turn as the wish to drive; the gates look at it before the wheels turn.
COMES_WITH_THE_WISH: FrozenSet[Reason] = frozenset((Reason.MANUAL_STALE, Reason.NO_MISSION))
HOLDS: FrozenSet[Reason] = _ASTRAY | {Reason.LINK_LOST, Reason.MANUAL_STALE, Reason.ARRIVED}


class Verdict(NamedTuple):
    """The state, since when, and why, in a code and in words."""

    state: State
    reason: Reason
    sentence: str
    since_s: float


class Answer(NamedTuple):
    """Whether a command was done; the sentence says why not."""

    accepted: bool
    sentence: str


class Safety:
    """The supervisor. Its caller looks whether ``verdict.state`` is `MOVING` before every motion.

    Not for several threads at once. The clock is monotonic [s]; while ``never`` says why not, no
    command leads to an armed state.
    """

    def __init__(
        self, clock: Callable[[], float], limits: Optional[SafetyLimits] = None, never: str = ""
    ) -> None:
        self.limits = limits or SafetyLimits()
        self._never = never
        self._clock = clock
        self._inputs: Optional[Inputs] = None
        self._looked_s = now_s = clock()
        self.verdict = Verdict(State.DISARMED, Reason.BOOT, "started; a person must arm", now_s)

    def check(self, inputs: Inputs) -> Verdict:
        """Look at every gate; call once per turn of the loop, however bad the turn was."""
        now_s = self._clock()
        loop_age_s = now_s - self._looked_s
        self._inputs, self._looked_s = inputs, now_s
        self._act_on(inputs, loop_age_s, frozenset(Reason))
        return self.verdict

    def watch(self) -> Verdict:
        """Look whether ``check`` is overdue, or a pose or the operator have grown too old since.

        For a second thread, which looks more often, and also when the first one hangs.
        """
        if self._inputs is not None:
            since_s = self._clock() - self._looked_s
            self._act_on(self._inputs.aged(max(since_s, 0.0)), since_s, GROWS_OLD)
        return self.verdict

    def fault(self, reason: Reason, sentence: str) -> Verdict:
        """A part failed. The first fault is kept until a person clears it."""
        if self.verdict.state is not State.FAULT:
            self._enter(State.FAULT, reason, sentence)
        return self.verdict

    def arrived(self) -> Verdict:
        """The destination is reached: stand."""
        if self.verdict.state is State.AUTO:
            self._enter(State.HOLD, Reason.ARRIVED, "arrived")
        return self.verdict

    def command(self, command: Command) -> Answer:
        """Do what a person asks, if it is possible from here and the gates hold."""
        state = self.verdict.state
        target = TRANSITIONS.get((state, command))
        if target is None:
            if command in ALWAYS_TAKEN or command.value == state.value.lower():
                return Answer(True, f"already {state.value}")
            possible = ", ".join(sorted(c.value for s, c in TRANSITIONS if s is state))
            sentence = f"{command.value} is not possible in {state.value}; possible: {possible}"
            return Answer(False, sentence)
        if target in WATCHED:
            problem = self._never or self._problem(target)
            if problem:
                return Answer(False, f"{command.value} is refused: {problem}")
        self._enter(target, Reason.PERSON, f"{command.value}, by a person")
        return Answer(True, "")

    def _problem(self, target: State) -> str:
        if self._inputs is None:
            return "the control loop has not run yet"
        loop_age_s = self._clock() - self._looked_s
        trip = self._trip(self._inputs, loop_age_s, WATCHED[target] - COMES_WITH_THE_WISH)
        return trip.sentence if trip else ""

    def _trip(self, inputs: Inputs, loop_age_s: float, asked: FrozenSet[Reason]) -> Optional[Trip]:
        """The gravest trip among these gates."""
        every = trips(inputs, loop_age_s, self.limits)
        tripped = [trip for trip in every if trip.reason in asked]
        return min(tripped, key=lambda trip: trip.reason in HOLDS, default=None)

    def _act_on(self, inputs: Inputs, loop_age_s: float, among: FrozenSet[Reason]) -> None:
        watched = WATCHED.get(self.verdict.state, frozenset())
        trip = self._trip(inputs, loop_age_s, watched & among)
        if trip is not None:
            state = State.HOLD if trip.reason in HOLDS else State.FAULT
            self._enter(state, trip.reason, trip.sentence)

    def _enter(self, state: State, reason: Reason, sentence: str) -> None:
        self.verdict = Verdict(state, reason, sentence, self._clock())
