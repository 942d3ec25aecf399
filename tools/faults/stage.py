"""The bench as the faults use it: drive, break, look, mend, look again.

With a localizer that can do what a real one must not: be late, jump, contradict itself.
"""

import math
import re
import secrets
from collections import deque
from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack
from dataclasses import replace
from pathlib import Path

import numpy as np

from robot.geometry import Pose, wrap_angle
from robot.link.keys import Keys, load_keys
from robot.link.messages import PosesMessage, Sighting
from robot.link.sockets import Link
from tools.faults.case import STOP_BUDGET_S, Case, Outcome
from tools.loop.bench import Bench, BenchOptions
from tools.loop.in_step import let_sockets_wait
from tools.loop.missions import Driver
from tools.loop.operator import Operator
from tools.loop.shared_time import SharedTime, message_number
from tools.loop.timekeeper import BenchError, Conductor
from tools.loop.town import OVERHEAD_FPS, ROBOT

# Of a true pose, the time since the lie began [s], and the true pose of then.
Lie = Callable[[Pose, float, Pose], Pose]


class StandIn:
    """Publishes the robot's true pose with the localizer's own keys, and lies when told to."""

    def __init__(self, bench: Bench, shared: SharedTime, keys: Keys | None = None) -> None:
        config = bench.link_configs["localizer"]
        self.late_s = 0.0
        self.clock_step_s = 0.0
        self.backwards = False
        self.twins = False  # two sessions at once
        self.instead: list[bytes] = []  # sent in place of poses
        self._bench = bench
        self.lies(lambda pose, *_: pose)
        self._told = shared.set if keys is None else lambda *_: None  # else nobody would hear it
        let_sockets_wait()
        self._link = Link(keys or load_keys(config.keys), config)
        self._socket = self._link.bind(PosesMessage.KIND, 2**21)
        self._sessions = (secrets.token_hex(8), secrets.token_hex(8))
        self._sequence = 0
        self._waiting: deque[tuple[float, PosesMessage]] = deque()
        self._event = bench.time.every(1.0 / OVERHEAD_FPS, self._tell)

    def close(self) -> None:
        """Fall silent."""
        self._bench.time.forget(self._event)
        self._link.close()

    def lies(self, lie: Lie) -> None:
        """From now on tell what ``lie`` makes of the true pose."""
        self._lie, self._since_s, self._first = lie, self._bench.now_s, self._bench.town.pose

    def _send(self, data: bytes) -> None:
        self._link.allow_list.admit()
        self._socket.send(data)

    def _tell(self) -> None:
        for data in self.instead:
            self._send(data)
        if self.instead:
            return
        self._sequence += 1
        bench_s = self._bench.now_s
        told = self._lie(self._bench.town.pose, bench_s - self._since_s, self._first)
        x_m, y_m, heading_rad = told
        seen = Sighting(ROBOT, float(x_m), float(y_m), float(wrap_angle(heading_rad)), 0.95)
        now_s = bench_s + self.clock_step_s
        session = self._sessions[self._sequence % 2 if self.twins else 0]
        sequence = 10**6 - self._sequence if self.backwards else 10**6 + self._sequence
        stamped = PosesMessage((seen,), now_s, session, sequence, now_s)
        self._waiting.append((bench_s + self.late_s, stamped))
        while self._waiting and self._waiting[0][0] <= bench_s:
            sent = self._waiting.popleft()[1]
            self._send(sent.to_bytes())
            self._told(sent.KIND, message_number(sent.session, sent.sequence))


START = Pose(0.132, 2.156, -math.pi / 2.0)  # on the longest straight lane of the arena
GOAL = (1.892, 1.76)  # the end of a lane, to which the way is longest
FROM = Pose(2.068, 0.563, math.pi / 2.0)  # 4 m before the start: a robot finds its place on the way
RING = (Pose(0.66, 0.18, 0.0), (3.33, 1.85))  # the same on the loop, for who keeps its lane
AHEAD_M = 0.6  # of the start a second robot begins
DRIVE_S = 1.7  # until the fault comes: at full speed
AFTER_S = 0.8  # looked at after the budget is over
SILENT_S = 1.5  # the same, where the page must say that the robot is silent
HEALED_S = 1.2  # looked at after mending
SETTLE_S = 20.0
CONNECT_S = 0.05  # real time, at each turn, for a connection to come about
TAKEOVER_S = 1.5  # until an earlier session is forgotten
STAND_S = 0.5  # until a robot that was disarmed has braked: it would roll on where it is put
BELIEF_S = 3.0  # until a robot that was carried, just started, takes that for no error of the poses
MOVING = ("READY", "AUTO", "MANUAL")


class Stage:
    """Plays cases on one bench, one after the other. Use it in a ``with`` block."""

    def __init__(self, options: BenchOptions, folder: Path) -> None:
        self.bench = Bench(options, folder)
        assert isinstance(self.bench.time, Conductor)  # times of faults are of lock-step
        self.shared = self.bench.time.shared
        self.rng = np.random.default_rng(options.seed)
        self.stand_in: StandIn
        self.note = ""  # from a case's injection to its check
        self._broken = ExitStack()  # what mends it
        self.start, self.goal = RING if options.leader else (START, GOAL)
        self._driver = Driver(self.bench, self.rng)
        self.bench.town.world.place(self.start)

    def __enter__(self) -> "Stage":
        self.bench.__enter__()
        return self

    def __exit__(self, *_: object) -> None:
        self._broken.close()
        self.bench.close()

    def play(self, case: Case) -> Outcome:
        """Meet one fault; whatever goes wrong with that is told in the outcome."""
        outcome = Outcome(case.family, case.name, case.what, threshold_s=case.threshold_s)
        try:
            self.ready()
            case.before(self)
            if case.moving:
                self.drive_off()
            case.approach(self)
            outcome = self._meet(case, outcome)
            if case.drives_again and not outcome.problem:
                outcome = replace(outcome, problem=self._again_problem())
        except (BenchError, OSError) as error:
            outcome = replace(outcome, problem=f"the bench: {error}")
        self.recover()
        return outcome

    def ready(self) -> None:
        """DISARMED at the start, all programs alive and in touch."""
        bench = self.bench
        bench.revive()
        bench.meet()
        operator = bench.operator
        if operator.state == "FAULT":
            operator.ask("clear")
            self.run(0.3)
        bench.until(lambda: operator.ask("disarm")[0], SETTLE_S, "the robot to be disarmed")
        self.run(STAND_S)
        if not bench.options.localizer:
            self._find()
            return
        bench.town.world.place(self.start)
        places = [] if bench.options.leader else [(operator, self.start)]
        if bench.town.second is not None:
            bench.second.ask("disarm")
            ahead = self.start.moved(AHEAD_M, 0.0)
            bench.town.second.world.place(ahead)
            places.append((bench.second, ahead))

        def there() -> bool:
            operator.look()
            return operator.state == "DISARMED" and all(_stands(*each) for each in places)

        bench.until(there, SETTLE_S, "the robot to be ready at the start")
        self.run(BELIEF_S)
        bench.meet()

    def _find(self) -> None:
        """Told roughly where it stands, as without a localizer: it finds out, and drives there."""
        self.bench.town.world.place(FROM)
        self._driver.find()
        if self.bench.operator.state == "FAULT":
            raise BenchError(f"expected it to find its place: {self.bench.operator.reason}")
        record = self._driver.drive(self.start[:2])
        if not record.arrived:
            raise BenchError(f"expected it at the start, it is {record.phase}: {record.reason}")
        self.bench.until(lambda: self.bench.operator.ask("disarm")[0], SETTLE_S, "a rest")
        self.run(BELIEF_S)

    def drive_off(self) -> None:
        """On a mission, or along its lane, at full speed."""
        bench, operator = self.bench, self.bench.operator
        expect(operator, "arm")
        if bench.options.leader:
            bench.type("auto")
        else:
            expect(operator, "mission", self.goal)
        self.run(DRIVE_S)
        if operator.state != "AUTO":
            raise BenchError(f"expected AUTO, got {operator.state}: {operator.reason}")

    def run(self, duration_s: float) -> None:
        """Let time go on, with the page watched as long as it lives."""
        end_s = self.bench.now_s + duration_s
        while self.bench.now_s < end_s - 1e-9:
            if self.bench.page_lives:
                self.bench.operator.turn()
            else:
                self.bench.time.run_until(self.bench.now_s + 0.05)

    def replace_localizer(self, keys: Keys | None = None) -> None:
        """Poses come from the stand-in from now on, true ones to begin with.

        With ``keys`` that are not the localizer's, nobody is expected to hear them.
        """
        bench = self.bench
        bench.stop("localizer")
        self.stand_in = StandIn(bench, self.shared, keys)
        self._broken.callback(self.stand_in.close)
        if keys is not None:
            return

        def heard() -> bool:
            bench.operator.look()
            return bench.operator.age_s("pose") < 0.3

        self.run(TAKEOVER_S)
        bench.until(heard, SETTLE_S, "stand-in poses", CONNECT_S)

    def recover(self) -> None:
        """Everything as it was, with whatever programs must be started again."""
        self._broken.close()
        self.shared.set("lossy", 0.0)
        self.bench.revive()

    def _meet(self, case: Case, outcome: Outcome) -> Outcome:
        town, began_s = self.bench.town, self.bench.now_s
        broken = case.inject(self)
        if isinstance(broken, AbstractContextManager):
            self._broken.enter_context(broken)
        self.run(case.threshold_s + STOP_BUDGET_S + (SILENT_S if case.silent else AFTER_S))
        stopped_s = max(town.moved_s - began_s, 0.0) if case.states and case.moving else None
        state, reason = self._shown()
        problems = [self._stop_problem(case, stopped_s), _shown_problem(case, state, reason)]
        problems += [check(self) for check in case.check]
        if case.states and "AUTO" not in case.states:
            problems.append(self._resume_problem())
        told = "; ".join(filter(None, problems))
        return replace(outcome, stopped_s=stopped_s, state=state, reason=reason, problem=told)

    def _shown(self) -> tuple[str, str]:
        """State and reason on the page, or at the robot's terminal where there is no page."""
        bench, state = self.bench, ""
        page = bench.operator if bench.page_lives and bench.operator.watching else None
        reason = bench.processes["robot"].said().strip().rpartition("\n")[2]
        if page and not page.snapshot.get("silent"):
            state, reason = page.state, page.reason
        elif page:
            silence_s = page.snapshot["silence_s"]
            state = "silent"
            reason = f"silent for {silence_s:.1f} s; at the robot's terminal {reason}"
        elif told := re.match(r"([A-Z]+): (.*)", reason):
            state, reason = told[1], told[2]
        return state, reason.replace(f"{bench.folder}/", "")

    def _stop_problem(self, case: Case, stopped_s: float | None) -> str:
        if case.moving and not case.states:
            moving = self.bench.now_s - self.bench.town.moved_s < 0.3
            return "" if moving else "expected it to drive on, it stands"
        if stopped_s is None or stopped_s <= case.threshold_s + STOP_BUDGET_S:
            return ""
        late_ms = 1000.0 * (stopped_s - case.threshold_s)
        return f"the last step came {late_ms:.0f} ms after the threshold"

    def _resume_problem(self) -> str:
        """Mended, nothing may move, and nobody may be armed."""
        town, before_s = self.bench.town, self.bench.now_s
        self.recover()
        self.run(HEALED_S)
        if town.moved_s > before_s:
            return f"a motor stepped {town.moved_s - before_s:.2f} s after mending"
        state, _ = self._shown()
        return f"it is {state} after mending" if state in MOVING else ""

    def _again_problem(self) -> str:
        """A person clears and arms: the robot that stopped must drive, the same process."""
        process = self.bench.processes["robot"]
        self.ready()
        try:
            self.drive_off()
        except BenchError as error:
            return f"mended and armed again, it does not drive: {error}"
        same = process is self.bench.processes["robot"] and process.alive
        return "" if same else "it had to be started again"


def expect(page: Operator, kind: str, place: tuple[float, float] | None = None) -> None:
    """Ask at a page; BenchError where that is refused."""
    accepted, reason = page.ask(kind, place)
    if not accepted:
        raise BenchError(f"expected {kind} to be accepted, got: {reason}")


def _stands(page: Operator, place: Pose) -> bool:
    """Whether a robot is disarmed and knows that it stands there."""
    pose = page.robot.get("pose")
    if pose is None or page.state != "DISARMED":
        return False
    turned_rad = abs(float(wrap_angle(pose[2] - place.heading_rad)))
    return math.dist(pose[:2], place[:2]) < 0.05 and turned_rad < 0.1


def _shown_problem(case: Case, state: str, reason: str) -> str:
    wanted = ("silent",) if case.silent else case.states or ("AUTO",) * case.moving
    if wanted and state not in wanted:
        return f"expected {' or '.join(wanted)}, shown is {state}: {reason}"
    if case.says and not re.search(case.says, reason):
        return f"expected a reason with {case.says!r}, shown is {reason!r}"
    return ""
