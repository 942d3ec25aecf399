"""The commands of sight."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console

from robot.inference.policy import SHIPPED_MODELS

SHIPPED = SHIPPED_MODELS / "sight.onnx"


@dataclass(frozen=True)
class SightRun:
    """``config.yaml`` of a run."""

    files: int = 60  # Of some 5,200 pictures each, to learn from.
    steps: int = 24_000  # Of learning.
    batch: int = 128  # Pictures in a step.
    look: tuple[str, ...] = ("randomised", "wide")  # Looks, or folders of them; files take turns.
    seed: int = 0  # Of everything random.
    choosing_files: int = 4  # Of pictures by which uncertainties are scaled.
    base: str | None = None  # A sight, .onnx, that learns on; else one begins anew.
    photographs: str | None = None  # Folder of annotated photographs to learn from, too.


def train_command(out: Path, options: Annotated[SightRun, tyro.conf.arg(name="")]) -> int:
    """Teach a small network to see lane, red line, junction and whether there is a road.

    Learns on the training maps and is calibrated on those for choosing. Called again, it goes on
    where it was cut off. Leaves sight.onnx and sight_int8.onnx. Photographs of your own floor, with
    photographs.yaml beside them, are learned from as docs/photographs.md says.
    """
    from trainer.sight.train import train_sight

    console = Console(soft_wrap=True)
    console.print(f"{train_sight(out, options, console)}: written", markup=False)
    return 0


def draw_command(
    pictures: tyro.conf.Positional[Path], out: Path = Path("runs/sight"), model: Path = SHIPPED
) -> int:
    """Draw what sight sees over a picture, a folder of pictures, or a film.

    Args:
        pictures: any size; of others than 4:3 the middle is taken.
        out: folder for the drawn pictures, or the film.
        model: sight, .onnx.
    """
    from robot.vision.sight import OnnxSight
    from trainer.sight.draw import write_seen

    count = write_seen(OnnxSight(model), pictures, out)
    Console(soft_wrap=True).print(f"{out}: {count} pictures", markup=False)
    return 0
