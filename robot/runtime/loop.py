"""The robot's loop: observe, decide, limit, apply, tell the subscribers.

Whatever goes wrong in any part, the motors have stopped by the end of the same turn, and stay
stopped until a person has cleared the fault and armed again.
"""

import logging
import math
import threading
from typing import Any, Callable, Iterable, Optional, Sequence, Tuple, TypeVar

import numpy as np

from robot.camera.source import Camera, Frame
from robot.computer.clock import Clock
from robot.contract import CONTROL_DT_S, shares
from robot.errors import ContractError, HardwareError
from robot.geometry import STILL, WheelSpeeds
from robot.inference.policy import best_action, values_of
from robot.inference.preprocess import check_frame
from robot.parts import Guidance, Motors, Navigator, Operator, Policy, Subscriber, Tick
from robot.runtime.timing import RateKeeper
from robot.safety.gates import Inputs, Reason
from robot.safety.governors import Cap, Road, Rule, govern
from robot.safety.state_machine import COILS_OFF, MOVING, Answer, Command, Safety, State
from robot.safety.wheel_limits import Drive
from robot.vision.plausibility import PictureDoubts, Sight

T = TypeVar("T")
# The flags of the way, which the gates know by the same names.
WAY_DOUBTS = Guidance._fields[Guidance._fields.index("off_path") :]
logger = logging.getLogger(__name__)


class Runtime:
    """Puts the parts together; ``step`` is one turn, ``run`` keeps turning on time.

    ``watch`` may be called by one other thread; everything else belongs to one thread, which has
    the motors in its ``with`` block. Camera, safety and this go by one monotonic clock. Subscribers
    are told of every turn in this order; of the operators each counts, and ``ask`` is another way.
    A policy with a path input needs a navigator, ContractError without. Eyes doubt the pictures;
    the rules of the road are for a robot that drives by itself.
    """

    def __init__(
        self,
        camera: Camera,
        policy: Policy,
        motors: Motors,
        safety: Safety,
        clock: Clock,
        subscribers: Iterable[Subscriber] = (),
        operators: Iterable[Operator] = (),
        navigator: Optional[Navigator] = None,
        eyes: Optional[PictureDoubts] = None,
        rules: Sequence[Rule] = (),
    ) -> None:
        if policy.contract.path_points and navigator is None:
            raise ContractError(
                f"policy: expected one without a path input, got a {policy.contract.task} policy; "
                "give the robot a map and a link to the localizer, or use a lane policy"
            )
        self.safety = safety
        self._camera, self._policy, self._motors = camera, policy, motors
        self._clock = clock
        self._subscribers = tuple(subscribers)
        self._operators, self._navigator, self._eyes = tuple(operators), navigator, eyes
        self._guard_motion = threading.RLock()  # safety, motors and what was last sent to them
        self._every_rule = self._rules = tuple(rules)
        self._number = 0
        self._wheels = STILL
        self._commands = (0.0,) * (2 * policy.contract.commands)  # told to it, the oldest first
        self._drove: Optional[Drive] = None  # in this turn
        self._sent_s = clock.now()
        self._resting: Optional[State] = None  # the state that the motors were last put to rest in
        self._manual: Optional[Tuple[WheelSpeeds, float]] = None
        self._frame: Optional[Frame] = None
        self._repeats = 0

    def ask(self, command: Command, wheels: Optional[WheelSpeeds] = None) -> Answer:
        """What a person asks for; ``wheels`` [m/s] go with MANUAL, and hold for 0.3 s.

        A fault is cleared only when the motors work again.
        """
        if command is Command.CLEAR and self.safety.verdict.state is State.FAULT:
            try:
                self._motors.mend()
            except HardwareError as error:
                return Answer(False, f"clear is refused: {error}")
        with self._guard_motion:
            answer = self.safety.command(command)
            if answer.accepted and command is Command.MANUAL:
                self._manual = (wheels or STILL, self._clock.now())
            self._rest_unless_moving()
        return answer

    def step(self, lag_s: float = 0.0) -> Tick:
        """One turn. Errors of the parts become faults, not exceptions."""
        began_s = self._clock.now()
        link_age_s = self._try(Reason.OPERATOR, self._listen)
        frame = self._try(Reason.CAMERA, self._look)
        guidance = None
        if self._navigator is not None:
            guidance = self._try(Reason.NAVIGATOR, self._navigator.look, began_s)
        way = guidance or Guidance()
        image = None if frame is None else frame.image
        asked = (self._policy, image, way.path, self._commands)
        values = self._try(Reason.POLICY, values_of, *asked)
        action = best_action(values)
        self._drove, sight = None, None
        if self._eyes is not None:
            seen = (frame, way.pose, self._wheels, self._clock.now())
            sight = self._try(Reason.CAMERA, self._eyes.look, *seen)
        told = (link_age_s, frame, way, sight or Sight(), action)
        inputs = self._try(Reason.RUNTIME, self._act, *told)
        duration_s = self._clock.now() - began_s
        tick = Tick(
            *(self._number, began_s, frame, values, action, self._wheels, self.safety.verdict),
            *(inputs or Inputs(math.inf), guidance, duration_s, lag_s, self._drove, self._commands),
        )
        self._number += 1
        self._commands = (*self._commands, *shares(self._wheels))[2:]
        for subscriber in self._subscribers:
            self._try(Reason.SUBSCRIBER, subscriber.on_tick, tick)
        return tick

    def run(self, ending: Callable[[], bool]) -> None:
        """Turn every ``CONTROL_DT_S`` until ``ending()``; however that comes, then disarm."""
        rate = RateKeeper(CONTROL_DT_S, self._clock)
        try:
            while not ending():
                self.step(rate.wait())
        finally:
            self.ask(Command.DISARM)

    def watch(self) -> None:
        """Stop the motors when the loop hangs; for a second thread, several times a second."""
        with self._guard_motion:
            self.safety.watch()
            self._rest_unless_moving()

    def _listen(self) -> Optional[float]:
        """Serve the operators; the longest silence [s] among those who must be heard."""
        for operator in self._operators:
            operator.serve(self.ask)
        ages = (operator.age_s() for operator in self._operators)
        return max((age_s for age_s in ages if age_s is not None), default=None)

    def _look(self) -> Optional[Frame]:
        frame = self._camera.read()
        if frame is not None:
            check_frame(frame.image)
            if not math.isfinite(frame.time_s):
                raise ContractError(f"frame: expected a finite time [s], got {frame.time_s}")
        return frame

    def _act(
        self,
        link_age_s: Optional[float],
        frame: Optional[Frame],
        way: Guidance,
        sight: Sight,
        action: Optional[int],
    ) -> Inputs:
        """Look at the gates, then drive or rest. After this only a subscriber can still fail."""
        with self._guard_motion:
            now_s = self._clock.now()
            navigates = self._policy.contract.path_points > 0
            no_mission = navigates and way.path is None
            inputs = Inputs(
                frame_age_s=math.inf if frame is None else now_s - frame.time_s,
                frame_repeats=self._count_repeats(frame),
                blind_s=sight.blind_s,
                still_s=sight.still_s,
                picture_wrong=sight.wrong,
                values_finite=action is not None or no_mission,  # without a path nobody asked it
                pose_age_s=way.pose_age_s if navigates and way.pose_within is None else None,
                pose_within=way.pose_within if navigates else None,
                link_age_s=link_age_s,
                manual_age_s=None if self._manual is None else now_s - self._manual[1],
                no_mission=no_mission,
                **{doubt: getattr(way, doubt) for doubt in WAY_DOUBTS},
            )
            self.safety.check(inputs)
            if way.arrived:
                self.safety.arrived()
            wanted, cap = self._wanted(action), self._govern(way, now_s)
            if wanted is not None:
                self._try(Reason.MOTORS, self._drive, wanted, now_s, cap)
            self._rest_unless_moving()
        return inputs

    def _count_repeats(self, frame: Optional[Frame]) -> int:
        """New frames in a row with the bytes of the one before, while the wheels turn. A robot
        that stands may well see the same picture twice."""
        last, self._frame = self._frame, frame
        if frame is None or last is None or self._wheels == STILL:
            self._repeats = 0
        elif frame.sequence != last.sequence:
            same = np.array_equal(frame.image, last.image)
            self._repeats = self._repeats + 1 if same else 0
        return self._repeats

    def _wanted(self, action: Optional[int]) -> Optional[WheelSpeeds]:
        state = self.safety.verdict.state
        if state is State.AUTO and action is not None:
            return self._policy.contract.wheels(action)
        if state is State.MANUAL and self._manual is not None:
            return self._manual[0]
        return None

    def _govern(self, way: Guidance, now_s: float) -> Cap:
        """What the rules of the road allow; they begin anew with each drive."""
        if self.safety.verdict.state is not State.AUTO:
            self._rules = self._every_rule
            return Cap()
        road = Road(now_s, way.driven_m, max(map(abs, self._wheels)), way.ahead)
        self._rules, cap = govern(self._rules, road)
        return cap

    def _drive(self, wanted: WheelSpeeds, now_s: float, cap: Cap) -> None:
        limits = self.safety.limits
        dt_s = min(max(now_s - self._sent_s, 0.0), limits.loop_age_s)
        drive = Drive(wanted, self._wheels, dt_s, cap)
        wheels = drive.limited(limits.max_wheel_mps)
        self._resting = None
        self._motors.set_wheels(wheels)
        self._drove = drive
        self._wheels, self._sent_s = wheels, now_s

    def _rest_unless_moving(self) -> None:
        """Put the motors to rest, once in each state; again in every turn while that fails."""
        if self.safety.verdict.state in MOVING or self.safety.verdict.state is self._resting:
            return
        self._wheels, self._manual = STILL, None
        rested, _ = self._attempt(Reason.MOTORS, self._motors.stop)
        if self.safety.verdict.state in COILS_OFF:
            released, _ = self._attempt(Reason.MOTORS, self._motors.release)
            rested = rested and released
        self._resting = self.safety.verdict.state if rested else None

    def _try(self, reason: Reason, part: Callable[..., T], *arguments: Any) -> Optional[T]:
        """Call a part; None after an error, with the motors at rest."""
        done, result = self._attempt(reason, part, *arguments)
        if not done:
            with self._guard_motion:
                self._rest_unless_moving()
        return result

    def _attempt(
        self, reason: Reason, part: Callable[..., T], *arguments: Any
    ) -> Tuple[bool, Optional[T]]:
        """Call a part; whatever it raises becomes a fault of this reason."""
        try:
            return True, part(*arguments)
        except Exception as error:
            with self._guard_motion:
                before = self.safety.verdict
                sentence = f"{reason.value}: {str(error) or type(error).__name__}"
                if self.safety.fault(reason, sentence) is not before:
                    self._rest_unless_moving()  # before the log, which may be slow
                    logger.error("fault: %s", sentence, exc_info=error)
            return False, None
