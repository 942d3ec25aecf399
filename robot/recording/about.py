"""Who drives: what a recording says about it, and what it takes to replay it."""

from __future__ import annotations

import json
import platform
from dataclasses import dataclass, field
from pathlib import Path
from typing import Callable, Dict, Mapping, Optional

from robot.config import RobotConfig
from robot.geometry import Pose
from robot.link.messages import PoseMessage
from robot.link.telemetry import Telemetry
from robot.typed_config import to_plain

MODEL, TRANSLATOR = "model.onnx", "translator.onnx"  # attachments of a recording


@dataclass(frozen=True)
class Subject:
    """Facts for the head of a recording, its models, and what a tick does not tell."""

    name: str
    about: Mapping[str, str] = field(default_factory=dict)
    models: Mapping[str, Path] = field(default_factory=dict)
    odometry: Optional[Callable[[], Pose]] = None
    report: Optional[Callable[[], Optional[Telemetry]]] = None  # on the newest turn
    overhead: Optional[Callable[[], Optional[PoseMessage]]] = None  # the localizer's newest


def describe(
    config: RobotConfig,
    odometry: Optional[Callable[[], Pose]] = None,
    report: Optional[Callable[[], Optional[Telemetry]]] = None,
    overhead: Optional[Callable[[], Optional[PoseMessage]]] = None,
) -> Subject:
    """A configured robot. Its models' files are read again while the recording is written."""
    models = {MODEL: Path(config.model)}
    if config.translator:
        models[TRANSLATOR] = Path(config.translator)
    about = {
        "robot": config.name,
        "map": config.map,
        "model": Path(config.model).name,
        "max_wheel_mps": repr(config.safety.max_wheel_mps),
        "config": json.dumps(to_plain(config)),
        **arithmetic(),
    }
    return Subject(config.name, about, models, odometry, report, overhead)


def arithmetic() -> Dict[str, str]:
    """What a policy's last bits depend on: processor, onnxruntime, and OpenCV, which resizes."""
    import cv2
    import onnxruntime

    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    told = ("model name", "CPU part")
    model = next((line.split(":", 1)[1].strip() for line in lines if line.startswith(told)), "")
    return {
        "machine": platform.machine(),
        "processor": model,
        "onnxruntime": onnxruntime.__version__,
        "opencv": cv2.__version__,
    }
