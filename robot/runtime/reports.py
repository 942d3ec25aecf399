"""What the robot says about itself after every turn, for the monitor."""

from dataclasses import replace
from typing import Callable, Optional, Tuple

import numpy as np

from robot.link.messages import TEXT_BYTES, FrameMessage, InputAge, Reading, Telemetry, told_age
from robot.link.wire import tidy_text
from robot.navigation.navigator import MissionNavigator
from robot.parts import Tick
from robot.safety.gates import SafetyLimits
from robot.safety.state_machine import MOVING, State

JPEG_QUALITY = 85
SAME_MPS = 1e-5  # a person's wheels come with six decimals
SMOOTHING = 0.1  # of the rate of decisions: ten turns' memory


class Reporter:
    """Publishes each turn and its picture; keeps ``robot.parts.Subscriber``.

    ``publish`` and ``show`` are None without a link, ``navigator`` where the robot keeps its lane.
    """

    def __init__(
        self,
        publish: Optional[Callable[[Telemetry], object]],
        show: Optional[Callable[[FrameMessage], object]],
        about: Telemetry,
        limits: SafetyLimits,
        navigator: Optional[MissionNavigator] = None,
        health: Callable[[], Tuple[Reading, ...]] = tuple,
    ) -> None:
        self.newest: Optional[Telemetry] = None
        self._publish, self._show = publish, show
        self._about, self._limits = about, limits
        self._navigator, self._health = navigator, health
        self._shown = -1
        self._last_s: Optional[float] = None
        self._period_s = 0.0

    def on_tick(self, tick: Tick) -> None:
        """Report this turn."""
        import cv2

        self.newest = self._report(tick)
        if self._publish is not None:
            self._publish(self.newest)
        if self._show is not None and tick.frame is not None and tick.frame.sequence != self._shown:
            self._shown = tick.frame.sequence
            quality = [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY]
            jpeg = cv2.imencode(".jpg", tick.frame.image[..., ::-1], quality)[1].tobytes()
            self._show(FrameMessage(jpeg, max(tick.frame.time_s, 0.0)))

    def _report(self, tick: Tick) -> Telemetry:
        guidance, navigator = tick.guidance, self._navigator
        pose = guidance.pose if guidance is not None else None
        inputs, limits = tick.inputs, self._limits
        ages = (
            ("camera", inputs.frame_age_s, limits.frame_age_s),
            ("pose", inputs.pose_age_s, limits.pose_age_s),
            ("operator", inputs.link_age_s, limits.link_age_s),
        )
        governed = "" if tick.drive is None else tick.drive.cap.reason
        values = np.zeros(0) if tick.values is None else tick.values
        return replace(
            self._about,
            state=tick.verdict.state.value,
            reason=tidy_text(governed or tick.verdict.sentence, TEXT_BYTES),
            action=self._driven(tick),
            values=tuple(round(v, 4) for v in values.tolist()) if np.isfinite(values).all() else (),
            pose=None if pose is None else (pose.x_m, pose.y_m, pose.heading_rad),
            path=navigator.path_points if navigator else (),
            mission=navigator.status if navigator else None,
            belief=navigator.belief(tick.time_s) if navigator else None,
            inputs=tuple(InputAge(n, told_age(s), most) for n, s, most in ages if s is not None),
            health=self._health(),
            wheels=(float(tick.wheels[0]), float(tick.wheels[1])),
            fps=self._rate(tick.time_s),
            lag_s=told_age(tick.inputs.frame_age_s) or 0.0,
        )

    def _driven(self, tick: Tick) -> Optional[int]:
        """The policy's action while that drives, or a person's; None at rest."""
        if tick.verdict.state is not State.MANUAL or tick.drive is None:
            return tick.action if tick.verdict.state in MOVING else None
        off = np.abs(np.subtract(self._about.actions, tick.drive.wanted)).max(axis=1)
        return int(off.argmin()) if off.min() < SAME_MPS else None

    def _rate(self, now_s: float) -> float:
        """Decisions a second."""
        if self._last_s is not None:
            period_s = max(now_s - self._last_s, 1e-3)
            self._period_s += (SMOOTHING if self._period_s else 1.0) * (period_s - self._period_s)
        self._last_s = now_s
        return 1.0 / self._period_s if self._period_s else 0.0
