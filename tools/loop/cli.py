"""The options of the loop bench, and its command; imports nothing heavy."""

import shutil
import sys
from argparse import ArgumentTypeError
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Literal

import tyro

from robot.command_line import pair
from robot.errors import ConfigError
from robot.inference.policy import SHIPPED_MODELS

NAVIGATOR = SHIPPED_MODELS / "nav_dueling.onnx"
LANE_KEEPER = SHIPPED_MODELS / "lane_dueling.onnx"
_OF_LAPS = ("map", "model", "look", "seed", "video", "json", "laps", "translator")


@dataclass(frozen=True)
class LoopOptions:
    """What is driven, by whom and where."""

    map: str | None = None  # A map file, or the name of a shipped one; else arena, of laps loop.
    # An ONNX policy; else nav_dueling, of laps lane_dueling.
    model: Path | None = None
    look: str = "nominal"  # A YAML file, a folder of them, or a shipped name.
    seed: int = 0  # Of everything random.
    video: Path | None = None  # Write a film of the drive, an MP4.
    json: Path | None = None  # Write the figures; missions go on with what is there.
    missions: int = 1  # How many, each to a random place.
    start: str | None = None  # X,Y: where the first mission begins [m]; else anywhere.
    goal: str | None = None  # X,Y: where the only mission leads [m].
    sight: Path | None = None  # ONNX; it alone tells the place, without a localizer.
    # expert: by hand all the way; person: takes over where the policy strays.
    driver: Literal["policy", "expert", "person"] = "policy"
    record: Path | None = None  # A folder: keep the robot's recordings of the drives.
    realtime: bool = False  # By the wall clock, not in step.
    robot_python: str = sys.executable  # Runs the robot's process.
    # So many laps of a ring of road instead, one robot alone, in one process and in lock-step.
    laps: float | None = None
    translator: str | None = None  # Of laps: an ONNX translator, real-to-sim, before the policy.

    def check(self) -> None:
        """ConfigError for options that do not go together."""
        laps = self.laps is not None
        for each in fields(self):
            amiss = each.name not in _OF_LAPS if laps else each.name == "translator"
            if amiss and getattr(self, each.name) != each.default:
                flag = f"--{each.name.replace('_', '-')}"
                raise ConfigError(f"{flag}: expected it {'without' if laps else 'with'} --laps")
        if self.goal is not None and self.missions > 1:
            raise ConfigError(f"--goal: expected one mission, got --missions {self.missions}")
        if shutil.which(self.robot_python) is None:
            raise ConfigError(f"--robot-python: expected a Python to run, got {self.robot_python}")
        for name in ("start", "goal"):
            self.place(name)

    def place(self, name: str) -> tuple[float, float] | None:
        """``start`` or ``goal`` in metres."""
        text = getattr(self, name)
        try:
            return None if text is None else pair("X,Y in metres, such as 1.2,0.4")(text)
        except ArgumentTypeError as error:
            raise ConfigError(f"--{name}: {error}") from error

    @property
    def policy(self) -> Path:
        """What drives."""
        return self.model or (NAVIGATOR if self.laps is None else LANE_KEEPER)

    @property
    def road(self) -> str:
        """The map."""
        return self.map or ("arena" if self.laps is None else "loop")


def loop_command(options: Annotated[LoopOptions, tyro.conf.arg(name="")] = LoopOptions()) -> int:
    """The whole system drives missions on the bench.

    A world process holds town, wheels, HAT and cameras; robot, localizer and monitor are the
    programs as they are, over encrypted links; missions are clicked, in effect, on the monitor's
    page.
    """
    options.check()
    if options.laps is not None:
        from tools.loop.laps import tell

        return tell(options)
    from tools.loop.drive import drive

    return drive(options)
