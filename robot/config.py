"""``RobotConfig``: everything about one robot, as its YAML file says it."""

import math
import re
from dataclasses import dataclass, field
from typing import Literal, Optional

from robot.contract import CONTROL_DT_S
from robot.errors import ConfigError, expect_between
from robot.hat.config import HatConfig
from robot.lens import DUCKIEBOT_LENS, Lens, Mount
from robot.link.sockets import LinkConfig
from robot.safety.gates import SafetyLimits
from robot.safety.governors import Rules

CSI_FPS = 30  # of the IMX219's mode 3, which `robot.camera.source.csi_command` sets


@dataclass(frozen=True)
class CameraConfig:
    """Where frames come from; ConfigError: settings that contradict each other."""

    kind: Literal["csi", "v4l2", "socket"] = "csi"
    number: int = 0  # of the CSI port, or of /dev/video
    flip: int = 0  # csi only: nvvidconv's flip-method; 2 turns the picture upside down
    fps: int = 30
    path: str = ""  # of a virtual camera's socket
    lens: Lens = DUCKIEBOT_LENS  # ``calibrate lens`` writes it
    mount: Mount = field(default_factory=Mount)  # ``calibrate camera``: pitch, roll and height

    def __post_init__(self) -> None:
        if (self.kind == "socket") != bool(self.path):
            raise ConfigError("camera.path: expected a path with kind socket, and only with it")
        wide_px = self.lens.width_px
        expect_between("camera.lens.fx_px", self.lens.fx_px, 0.1 * wide_px, 100.0 * wide_px)
        expect_between("camera.fps", self.fps, round(1.0 / CONTROL_DT_S), 120)
        if self.kind == "csi" and self.fps > CSI_FPS:
            raise ConfigError(
                f"camera.fps: expected at most {CSI_FPS} with a CSI camera, got {self.fps}; its "
                "mode is 1640x1232, and faster ones see only the middle of the picture"
            )
        if not (0 <= self.number <= 999 and 0 <= self.flip <= 7):
            got = f"got number {self.number}, flip {self.flip}"
            raise ConfigError(f"camera: expected number 0 to 999 and flip 0 to 7, {got}")


@dataclass(frozen=True)
class RecordingConfig:
    """Where drives are recorded, and how much of the disk they leave alone."""

    folder: str
    keep_free_mb: float = 500.0  # the system needs room for its own logs and updates

    def __post_init__(self) -> None:
        if not self.folder:
            raise ConfigError("recording.folder: expected one; or leave the recording section out")
        if not 0.0 <= self.keep_free_mb < math.inf:
            raise ConfigError(f"recording.keep_free_mb: expected >= 0, got {self.keep_free_mb}")


@dataclass(frozen=True)
class RobotConfig:
    """One robot. Only ``model`` has no default. ConfigError: parts that contradict each other."""

    model: str  # an ONNX policy
    name: str = "robot"  # in poses and telemetry
    map: str = ""  # a map file or the name of a shipped one; for navigation
    sight: str = ""  # ONNX; tells what is in the way, and where a robot with a map is
    translator: str = ""  # ONNX, real-to-sim or a parser: for a policy that knows its pictures only
    camera: CameraConfig = CameraConfig()
    hat: HatConfig = field(default_factory=HatConfig)
    safety: SafetyLimits = field(default_factory=SafetyLimits)
    rules: Rules = field(default_factory=Rules)  # of the road
    recording: Optional[RecordingConfig] = None  # of every drive, in MCAP; without: none
    link: Optional[LinkConfig] = None  # to localizer and monitor; without: the terminal alone

    def __post_init__(self) -> None:
        if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,31}", self.name):  # as messages have it
            told = f"1 to 32 letters, digits or ._-, got {self.name[:80]!r}"
            raise ConfigError(f"name: expected {told}")
        if self.safety.max_wheel_mps > self.hat.max_speed_mps:
            told = f"{self.safety.max_wheel_mps:g}, got {self.hat.max_speed_mps:g}; lower the other"
            raise ConfigError(f"hat.max_speed_mps: expected at least safety.max_wheel_mps {told}")
        # A monitor that is silent for 2 s is forgotten: then others' word counts.
        most = {"link_age_s": 1.5, "frozen_frames": 100, "pose_within_m": 0.5}
        for name, value in vars(self.safety).items():
            expect_between(f"safety.{name}", value, 0.0, most.get(name, 3.0))
        two_s = 2.0 * CONTROL_DT_S  # decisions
        expect_between("hat.command_timeout_s", self.hat.command_timeout_s, two_s, 2.0)
        if self.map and self.link is None:
            raise ConfigError("map: expected a link as well, to hear poses and destinations by")
        if self.rules.stop_lines and not self.map:
            raise ConfigError("rules.stop_lines: expected a map as well, to know lines by")
        if self.link and self.link.robots and not (self.rules.headway and self.map and self.sight):
            raise ConfigError("link.robots: expected map, sight and rules.headway, or no robots")
        if self.rules.headway and not (self.map or self.sight):
            raise ConfigError("rules.headway: expected sight as well, to see others by, or a map")
        if self.sight and not (self.map or self.rules.headway):
            raise ConfigError("sight: expected a map as well, to know lanes by, or rules.headway")
