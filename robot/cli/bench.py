"""Measure this computer as a robot: decisions, imports and memory, the loop's punctuality.

The loop turns in a process of its own, on pictures that are made up, and drives nowhere.
"""

from __future__ import annotations

import argparse
import importlib
import json
import os
import pkgutil
import platform
import subprocess
import sys
import time
from dataclasses import asdict
from pathlib import Path
from typing import Dict

import numpy as np

import robot
from robot.camera.source import Frame
from robot.command_line import number
from robot.computer.clock import Clock, MonotonicClock
from robot.contract import CONTROL_DT_S, PATH_POINTS
from robot.geometry import Pose
from robot.inference.policy import OnnxPolicy, time_decisions
from robot.inference.preprocess import FRAME_SHAPE
from robot.output import expect_writable, write_json
from robot.parts import Guidance
from robot.runtime.loop import Runtime
from robot.runtime.timing import RateKeeper
from robot.safety.gates import SafetyLimits
from robot.safety.state_machine import Command, Safety
from robot.vision.plausibility import PictureDoubts

CHILD = """import sys, time
began_s = time.perf_counter()
from robot.cli.bench import tell
tell(began_s, *sys.argv[1:])"""
# A stall of the computer must not end a measurement of stalls.
PATIENT = SafetyLimits(frame_age_s=60.0, loop_age_s=60.0)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The command's options."""
    parser.add_argument("--model", type=Path, required=True, help="an ONNX policy")
    parser.add_argument("--json", type=Path, help="file to write")
    seconds = number(0.5, 3600.0)
    parser.add_argument("--seconds", type=seconds, default=5.0, help="how long the loop runs")


def run(options: argparse.Namespace) -> None:
    """Do it; DuckpilotError for a wrong model."""
    expect_writable(options.json, inputs=[options.model])
    decision = time_decisions(OnnxPolicy(options.model))
    print(f"decision    p50 {decision.p50_ms:.2f} ms, p99 {decision.p99_ms:.2f} ms (one thread)")
    found = measure(options.model, options.seconds)
    robot, loop = found["robot"], found["loop"]
    print(f"robot       imports {robot['import_s']:.2f} s, resident {robot['rss_mb']:.0f} MB")
    print(
        f"loop        late p50 {loop['lag_p50_ms']:.2f} ms, p99 {loop['lag_p99_ms']:.2f} ms, "
        f"most {loop['lag_max_ms']:.2f} ms; turn p50 {loop['turn_p50_ms']:.2f} ms"
    )
    if options.json:
        machine = {"machine": platform.machine(), "cpus": os.cpu_count()}
        asked = {"model": str(options.model), "seconds": options.seconds}
        inputs = {**asked, **machine, "python": platform.python_version()}
        report = {"schema": 1, "inputs": inputs, "inference": asdict(decision), **found}
        write_json(options.json, report)


def measure(model: Path, seconds: float) -> Dict[str, Dict[str, float]]:
    """Start a fresh Python that imports every module of ours and drives for so long.

    ``robot``: seconds to import, greatest resident memory [MB]; ``loop``: how late turns began, and
    how long they took from camera to wheels [ms]. ContractError: the model keeps no contract.
    """
    OnnxPolicy(model)
    root = str(Path(__file__).resolve().parents[2])
    path = os.pathsep.join(filter(None, (root, os.environ.get("PYTHONPATH"))))
    done = subprocess.run(
        [sys.executable, "-c", CHILD, str(model), str(seconds)],
        check=True,
        stdout=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": path},
    )
    found: Dict[str, Dict[str, float]] = json.loads(done.stdout)
    return found


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

    def _nothing(self, *_: object) -> None:
        pass

    set_wheels = stop = release = mend = _nothing


class _StraightPath:
    def look(self, now_s: float) -> Guidance:  # noqa: ARG002  the path is always straight
        return Guidance(np.zeros(PATH_POINTS, np.float32), pose_age_s=0.0)


def dry_runtime(model: Path) -> Runtime:
    """A runtime in AUTO on noise pictures; ContractError for a model without a contract."""
    clock = MonotonicClock()
    safety = Safety(clock.now, PATIENT)
    runtime = Runtime(
        *(_NoiseCamera(clock), OnnxPolicy(model), _NoMotors(), safety, clock),
        navigator=_StraightPath(),
        eyes=PictureDoubts(),
    )
    runtime.step()
    for command in (Command.ARM, Command.AUTO):
        runtime.ask(command)
    return runtime


def tell(began_s: float, model: str, seconds: str) -> None:
    """What ``measure`` gives, as JSON; imports of ours began at ``began_s`` [s]."""
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
