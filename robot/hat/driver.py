"""The motors as the runtime sees them: wheel speeds in, steps and a pose out, off when in doubt."""

import math
from contextlib import contextmanager
from typing import Iterator, Optional

from robot.computer.clock import Clock
from robot.errors import ContractError, HardwareError
from robot.geometry import STILL, Pose, WheelSpeeds
from robot.hat.config import HatConfig
from robot.hat.stepper_hat import StepperHat
from robot.hat.stepping import StepPlanner, pose_after

PULL_S = 0.25  # with the field half a step beside
WAKE_S = PULL_S + 0.3  # a rotor swings to the field's direction when its coils come on
HELD_S = 0.3  # from braking to coils off; without current a rolling robot would coast on
CHECK_PERIOD_S = 0.05  # between two looks at the chip; all of it is seen in 22, or 1.1 s
PAUSE_S = 0.2  # as long as the control loop may be late
ALL_OFF_ATTEMPTS = 3


class MotorDriver:
    """Drives both wheels; somebody must call ``pump`` at every deadline that it returns.

    Used in a ``with`` block: entering finds the HAT, leaving brakes and switches every output off.
    A wheel speed counts for ``command_timeout_s``; then the robot ramps to a stop. Not for several
    threads (``thread.MotorThread`` is).

    HardwareError: from every method, when the HAT fails. All outputs are off by then, or the
    message says that they could not be switched off. The driver stays off until ``open``.
    """

    def __init__(self, hat: StepperHat, config: HatConfig, clock: Clock) -> None:
        self.config = config
        self._hat = hat
        self._clock = clock
        self.planner = StepPlanner(config, clock.now())  # knows the steps so far
        self.pose = Pose(0.0, 0.0, 0.0)  # where they led, from where it was when last set
        self._command = STILL
        self._commanded_s = self._moved_s = self._checked_s = self._settled_s = clock.now()
        self._pulled_s: Optional[float] = None  # when the field turns to where the rotors belong
        self._release_s: Optional[float] = None  # when a braking robot's coils are switched off
        self.fault: Optional[BaseException] = None  # since which all is off, until ``open``

    def __enter__(self) -> "MotorDriver":
        self.open()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def open(self) -> None:
        """Find and set up the HAT, coils off; also the way back after a fault."""
        self.fault = None
        with self._off_on_error():
            self._hat.open()
            self._rest()

    def mend(self) -> None:
        """``open`` after a fault; nothing to do without one."""
        if self.fault is not None:
            self.open()

    def close(self) -> None:
        """Brake, then every output off, the last word on the bus."""
        try:
            if self.fault is None:
                self.release()
            while self.energised and self.fault is None:
                deadline_s = self.pump(self._clock.now())
                if deadline_s is not None:
                    self._clock.sleep(deadline_s - self._clock.now())
        finally:
            self._rest()
            self._all_off()

    @property
    def energised(self) -> bool:
        """Whether the coils carry current."""
        return self._hat.duty is not None

    def set_wheels(self, wheels: WheelSpeeds) -> Optional[float]:
        """Aim for these rim speeds [m/s]; returns the next deadline, as ``pump`` does.

        ContractError for what is not finite, or beyond ``max_speed_mps``; nothing changes then.
        """
        limit = self.config.max_speed_mps
        if not all(math.isfinite(w) and abs(w) <= limit for w in wheels):
            raise ContractError(f"wheel speeds: expected -{limit:g} to {limit:g} m/s, got {wheels}")
        self._rest_after_a_pause(self._clock.now())
        self._command = WheelSpeeds(float(wheels.left_mps), float(wheels.right_mps))
        if self._command != STILL:
            self._release_s = None
        self._commanded_s = self._clock.now()
        return self.pump(self._commanded_s)

    def stop(self) -> None:
        """Brake within ``stepping.BRAKE_S``; the coils hold."""
        now_s = self._clock.now()
        self._rest_after_a_pause(now_s)
        self._command = STILL
        self.planner.brake(now_s)

    def release(self) -> None:
        """Every output off, so that the wheels turn freely; who rolls brakes for `HELD_S` first."""
        self._refuse_after_fault()
        now_s = self._clock.now()
        self._rest_after_a_pause(now_s)
        rolling = self.planner.deadline_s is not None or now_s < self._moved_s + HELD_S
        self.stop()
        if not (self.energised and rolling):
            self._all_off()
        elif self._release_s is None:
            self._release_s = now_s + HELD_S

    def fail(self, error: HardwareError) -> None:
        """Somebody found a fault: every output off, until ``open``; raises ``error``."""
        with self._off_on_error():
            raise error

    def pump(self, now_s: float) -> Optional[float]:
        """Do what is due at ``now_s`` [s]; returns when to call again, None for never."""
        self._refuse_after_fault()
        with self._off_on_error():
            self._rest_after_a_pause(now_s)
            if now_s >= self._commanded_s + self.config.command_timeout_s:
                self._command = STILL
            if self._release_s is not None and now_s >= self._release_s:
                self._rest()
                self._hat.release()
                return None
            if self._command != STILL and not self.energised:
                self._wake(now_s)
            if self._pulled_s is not None and now_s >= self._pulled_s:
                self._pulled_s = None
                self._hat.energise(self.config.run_duty)
            self.planner.set_speeds(now_s, self._command if now_s >= self._settled_s else STILL)
            steps = self.planner.advance(now_s)
            if any(steps):
                self._hat.move(steps)
                self.pose = pose_after(self.pose, steps, self.config)
                self._moved_s = now_s
            elif self.energised:
                self._look_after_standing_coils(now_s)
            if self.energised and now_s >= self._checked_s + CHECK_PERIOD_S:
                self._hat.check()
                self._checked_s = now_s
            return self._deadline_s(now_s)

    def _rest_after_a_pause(self, now_s: float) -> None:
        """Nobody stepped for so long that the wheels stand (the process was stopped, say): what was
        commanded before counts no longer, nor does its ramp down, nor the steps that were missed.
        """
        due_s = self.planner.deadline_s
        if due_s is not None and now_s > due_s + PAUSE_S:
            self._command = STILL
            self.planner.stand(now_s)

    def _wake(self, now_s: float) -> None:
        """Find the rotors, wherever they rest. One that rests opposite to the field is pulled to
        neither side, and would lose every step to come; so the field starts half a step beside."""
        self._hat.energise(self.config.run_duty, beside_full_steps=0.5)
        self._pulled_s = now_s + PULL_S
        self._settled_s = now_s + WAKE_S
        self._moved_s = self._checked_s = now_s

    def _look_after_standing_coils(self, now_s: float) -> None:
        if self._command != STILL or self.planner.deadline_s is not None:
            return
        config = self.config
        if now_s >= self._moved_s + config.release_after_s:
            self._hat.release()
        elif now_s >= self._moved_s + config.hold_after_s and self._hat.duty != config.hold_duty:
            self._hat.energise(config.hold_duty)

    def _deadline_s(self, now_s: float) -> Optional[float]:
        if not self.energised:
            return None
        step_s = self.planner.deadline_s
        moments = [self._checked_s + CHECK_PERIOD_S, step_s, self._release_s, self._pulled_s]
        if self._command != STILL:
            moments.append(self._commanded_s + self.config.command_timeout_s)
            if now_s < self._settled_s:
                moments.append(self._settled_s)
        elif step_s is None:
            held = self._hat.duty == self.config.hold_duty
            wait_s = self.config.release_after_s if held else self.config.hold_after_s
            moments.append(self._moved_s + wait_s)
        return min(moment for moment in moments if moment is not None)

    def _rest(self) -> None:
        """No further step from now on; for when nothing steps any more."""
        self._command = STILL
        self._pulled_s = self._release_s = None
        self.planner.freeze(self._clock.now())

    def _refuse_after_fault(self) -> None:
        if self.fault is not None:
            told = f"the motors are off since: {self.fault}; open() the driver again"
            raise HardwareError(told) from self.fault

    @contextmanager
    def _off_on_error(self) -> Iterator[None]:
        try:
            yield
        except BaseException as error:
            self.fault = error
            self._rest()
            self._all_off()
            raise

    def _all_off(self) -> None:
        """Try, and try again: these three bytes are what stands between a fault and hot coils."""
        for attempt in range(1, ALL_OFF_ATTEMPTS + 1):
            try:
                self._hat.release()
                return
            except HardwareError as error:
                if attempt == ALL_OFF_ATTEMPTS:
                    told = f"the coils could not be switched off, cut the motor supply: {error}"
                    raise HardwareError(told) from error
