"""A runtime that drives nowhere: the loop itself is measured, in a process of its own."""

import importlib
import json
import pkgutil
import time
from pathlib import Path

import numpy as np

import robot
from robot.camera.source import Frame
from robot.computer.clock import Clock, MonotonicClock
from robot.contract import CONTROL_DT_S, PATH_POINTS
from robot.geometry import Pose
from robot.inference.policy import OnnxPolicy
from robot.inference.preprocess import FRAME_SHAPE
from robot.parts import Guidance
from robot.runtime.loop import Runtime
from robot.runtime.timing import RateKeeper
from robot.safety.gates import SafetyLimits
from robot.safety.state_machine import Command, Safety
from robot.vision.plausibility import PictureDoubts

# A stall of the computer must not end a measurement of stalls.
PATIENT = SafetyLimits(frame_age_s=60.0, loop_age_s=60.0)


class _NoiseCamera:
    """Blotches that wander through noise: the robot must not take its camera for covered."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._rng = np.random.default_rng(0)
        self._sequence = 0
        height, width, _ = FRAME_SHAPE
        coarse = self._rng.integers(0, 224, (height // 20, width // 20, 3), dtype=np.uint8)
        self._scene = coarse.repeat(20, axis=0).repeat(20, axis=1)

    def read(self) -> Frame:
        self._sequence += 1
        noise = self._rng.integers(0, 32, FRAME_SHAPE, dtype=np.uint8)
        picture = np.roll(self._scene, self._sequence, axis=1) + noise
        return Frame(picture, self._sequence, self._clock.now())


class _NoMotors:
    pose = Pose(0.0, 0.0, 0.0)

    set_wheels = stop = release = mend = lambda *_: None


class _StraightPath:
    def look(self, now_s: float) -> Guidance:  # noqa: ARG002  the path is always straight
        return Guidance(np.zeros(PATH_POINTS, np.float32), pose_age_s=0.0)


def dry_runtime(model: Path) -> Runtime:
    """A runtime in AUTO on noise pictures; ContractError for a model without a contract."""
    clock = MonotonicClock()
    runtime = Runtime(
        *(_NoiseCamera(clock), OnnxPolicy(model), _NoMotors(), Safety(clock.now, PATIENT), clock),
        navigator=_StraightPath(),
        eyes=PictureDoubts(),
    )
    for command in (Command.ARM, Command.AUTO):
        runtime.step()  # two: one picture alone shows nothing
        runtime.ask(command)
    return runtime


def tell(began_s: float, model: str, seconds: str) -> None:
    """What `robot.cli.bench.measure` gives, as JSON; imports of ours began at ``began_s`` [s]."""
    for module in pkgutil.walk_packages(robot.__path__, "robot."):
        if not module.name.endswith("__main__"):
            importlib.import_module(module.name)
    import_s = time.perf_counter() - began_s
    runtime, count = dry_runtime(Path(model)), round(float(seconds) / CONTROL_DT_S)
    rate = RateKeeper(CONTROL_DT_S, MonotonicClock())
    ticks = [runtime.step(rate.wait()) for _ in range(count)]
    # Not from getrusage: its peak is inherited from the parent.
    status = Path("/proc/self/status").read_text(encoding="ascii").split()
    rss_mb = int(status[status.index("VmHWM:") + 1]) / 1024.0
    lags = np.percentile([1e3 * tick.lag_s for tick in ticks], (50, 99, 100)).tolist()
    turns = np.percentile([1e3 * tick.duration_s for tick in ticks], (50, 99)).tolist()
    names = ("lag_p50_ms", "lag_p99_ms", "lag_max_ms", "turn_p50_ms", "turn_p99_ms")
    loop = {"turns": len(ticks), **dict(zip(names, lags + turns))}
    print(json.dumps({"robot": {"import_s": import_s, "rss_mb": rss_mb}, "loop": loop}))
