"""The commands of sight."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console
from rich.progress import track

import robot
from robot.typed_config import to_plain

MODELS = Path(robot.__file__).parent / "models"
SHIPPED = MODELS / "sight.onnx"
SEERS = tuple(
    MODELS / f"{name}.onnx"
    for name in (
        *("lane_sight", "lane_coached", "lane_dueling", "lane_ppo"),
        *("nav_sight", "nav_dueling", "nav_ppo", "sight"),
    )
)


@dataclass(frozen=True)
class SightRun:
    """``config.yaml`` of a run."""

    files: int = 60
    """Of some 4,000 pictures each, to learn from."""
    steps: int = 24_000
    """Of learning."""
    batch: int = 128
    """Pictures in a step."""
    look: tuple[str, ...] = ("randomised", "wide")
    """Looks, or folders of looks, to learn in; files of pictures take turns."""
    seed: int = 0
    """Of everything random."""
    choosing_files: int = 4
    """Of pictures by which uncertainties are scaled."""


_RUN = SightRun()


def train_command(out: Path, options: Annotated[SightRun, tyro.conf.arg(name="")] = _RUN) -> int:
    """Teach a small network to see lane, red line, junction and whether there is a road.

    Learns on the training maps and is calibrated on those for choosing. Called again, it goes on
    where it was cut off. Leaves sight.onnx and sight_int8.onnx.

    Args:
        out: folder of the run.
        options: how much of what.
    """
    import torch

    from trainer.sight.train import train_sight

    torch.set_num_threads(1)
    console = Console(soft_wrap=True)
    console.print(f"{train_sight(out, options, console)}: written", markup=False)
    return 0


def judge_command(
    model: Path = SHIPPED,
    json: Path | None = None,
    look: tuple[str, ...] = ("randomised", "reality"),
    map_names: Annotated[tuple[str, ...], tyro.conf.arg(name="map")] = (),
    decisions: int = 400,
    seed: int = 1000,
) -> int:
    """Judge what sight sees of the road, and how sure it is, by experts that drive.

    Args:
        model: sight, .onnx.
        json: write the figures there.
        look: each a look, or a folder of looks.
        map_names: files, or names or folders of shipped maps; else all judging maps.
        decisions: of 20 robots, in each look.
        seed: of everything random.
    """
    from robot.navigation.road_map import load_map
    from robot.vision.sight import OnnxSight
    from sim_pybullet.randomise import load_look_sampler
    from trainer.division import division, maps_named
    from trainer.run import write_json
    from trainer.sight.judge import as_rows, judge
    from trainer.sight.pictures import anywhere, drive, missions, traffic

    sight = OnnxSight(model)
    maps = [load_map(name) for name in maps_named(map_names) or division().maps.judging]
    found = []
    for name in track(look, "looks", console=Console(stderr=True)):
        looks = load_look_sampler(name)
        driven = drive(missions(maps), looks, seed, decisions)
        met = drive(traffic(maps), looks, seed, decisions)
        found.append(judge(sight, name, driven, anywhere(maps, looks, seed), met))
    if json is not None:
        inputs = {"model": str(model), "maps": [m.name for m in maps], "seed": seed}
        write_json(json, {"inputs": inputs, "looks": [to_plain(each) for each in found]})
    head, *rows = as_rows(found)
    for row in (head, ["---"] * len(head), *rows):
        Console(soft_wrap=True).print(f"| {' | '.join(row)} |", markup=False)
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


def photographs_command(
    photographs: tyro.conf.Positional[Path],
    models: tuple[Path, ...] = SEERS,
    part: str = "judging",
    json: Path | None = None,
) -> int:
    """Judge all that sees on photographs that a person annotated (docs/photographs.md).

    Args:
        photographs: the folder that holds the sites' folders; they do not come with this.
        models: policies, and sight by its name, .onnx.
        part: sites kept for judging, or those for choosing.
        json: write the figures there, site by site.
    """
    from robot.errors import ConfigError, nearest
    from trainer.division import PARTS
    from trainer.judging.photographs import as_rows, figures, judge, seers
    from trainer.run import write_json

    if part not in PARTS[1:]:
        raise ConfigError(f"part: unknown {part!r}; {nearest(part, PARTS[1:])}")
    console = Console(soft_wrap=True)
    asked = seers(models)
    found = {
        name: figures(judge(see, photographs, part))
        for name, see in track(asked.items(), "asked", console=Console(stderr=True))
    }
    if json is not None:
        inputs = {"photographs": str(photographs), "part": part, "models": [str(m) for m in models]}
        write_json(json, {"inputs": inputs, "judged": found})
    for row in as_rows(found):
        console.print(f"| {' | '.join(row)} |", markup=False)
    return 0
