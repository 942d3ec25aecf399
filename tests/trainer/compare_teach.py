"""``python -m tests.trainer.compare_teach``: what of teaching brings how much, on judging floors.

A base learns on by the twin, by recorded frames, by the twin as a CycleGAN shows it or as two
networks do through a parser's classes, or by twin, CycleGAN and recorded frames, each with several
seeds; judged on the true floor, as by `tests.trainer.judge_teach`. With ``--json`` it goes on where
it was cut off.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import torch
from rich.console import Console
from torch.nn.functional import cross_entropy

from robot.command_line import OneLineParser, number, whole
from robot.contract import ImageSpec
from robot.inference.policy import OnnxTranslator, open_translator
from robot.navigation.road_map import load_map
from robot.output import write_json
from robot.typed_config import read_json
from sim_pybullet.randomise import look_sampler
from tests.trainer.judge_teach import floors, succeeded
from tests.trainer.virtual_drive import record_drive
from trainer.export import export_network
from trainer.learners.networks import GreedyNetwork
from trainer.resumable import descend, set_rate
from trainer.transfer.cli import ParseOptions, Source, Sources, ThroughOptions
from trainer.transfer.parser import train_parser
from trainer.transfer.pictures import collect
from trainer.transfer.pix2pix import translate_through
from trainer.twin.examples import Examples, examples_of
from trainer.twin.fit import fit_twin, write_twin
from trainer.twin.recorded import read_drives
from trainer.twin.teach import TeachConfig, base_file, load_base, teach
from trainer.twin.translation import FRAMES, twin_to_real

VARIANTS = ("nothing", "twin", "recorded", "cyclegan", "parsing", "all")
UPDATES = 2_000


def by_recorded(network: GreedyNetwork, person: Examples, config: TeachConfig, seed: int) -> None:
    """Learn from recorded frames alone, as often as `teach` learns, as fast."""
    rng, optimiser = (
        np.random.default_rng(seed),
        torch.optim.Adam(network.parameters(), config.rate),
    )
    shares = person.weights / person.weights.sum()
    for step in range(0, config.steps, config.every):
        set_rate([optimiser], config.rate * (1.0 - 0.9 * step / config.steps))
        rows = rng.choice(len(person.shares), config.batch + config.recorded, p=shares)
        seen = {name: part[rows] for name, part in person.observed.items()}
        told = torch.from_numpy(person.shares[rows])
        descend(optimiser, cross_entropy(network.logits(seen), told), 10.0)


def through_parsing(
    recording: Path, image: ImageSpec, out: Path, updates: int, seed: int, console: Console
) -> OnnxTranslator:
    """From the twin's pictures to the recorded ones, as `trainer parse translate` makes it.

    The parser learns from the twin, whose classes are known, and labels what was recorded.
    """
    sim, parsed = out / "sim", out / "parser"
    collect(sim, Source(frames=FRAMES, look=str(out / "twin.yaml"), seed=seed))
    parsed.mkdir()
    options = ParseOptions(Sources(pairs=(str(sim),)), steps=updates, seed=seed)
    train_parser(parsed, options, console)
    parser = str(parsed / "parser.pt")
    run = ThroughOptions(str(sim), str(recording), parser, steps=-(-updates // 5), seed=seed)
    return open_translator(translate_through(out, run, console), image)


def compare(
    options: argparse.Namespace, folder: Path, done: set[tuple[str, str, int]]
) -> Iterator[dict[str, Any]]:
    """A row for each floor, seed and variant that is not done yet."""
    base, config = base_file(options.base), TeachConfig(options.steps)
    console = Console(quiet=True)
    for k, (name, look) in enumerate(floors(0)):
        asked = [
            (variant, seed)
            for seed in range(options.seeds)
            for variant in VARIANTS
            if (name, variant, seed) not in done
        ]
        if name not in options.floors or not asked:
            continue
        out = folder / name
        out.mkdir()
        path = record_drive(look, options.map, options.seconds, k, out / "drive.mcap")
        drives = read_drives([path], lambda line: None)
        twin = fit_twin(drives)
        write_twin(twin, out / "twin.yaml")
        looks = look_sampler(twin.plain(), "twin")
        for variant, seed in asked:
            torch.manual_seed(seed)
            network, contract = load_base(base)
            person = examples_of(drives, twin.places, contract, held_out=False)
            nobody = Examples(*(None if part is None else part[:0] for part in person))
            shown, made = None, out / variant.replace("all", "cyclegan") / str(seed)
            made.mkdir(parents=True, exist_ok=True)
            (made / "twin.yaml").write_bytes((out / "twin.yaml").read_bytes())
            if variant in ("cyclegan", "all"):
                shown = twin_to_real([path], contract.image, made, options.updates, seed, console)
            elif variant == "parsing":
                shown = through_parsing(path, contract.image, made, options.updates, seed, console)
            if variant == "recorded":
                by_recorded(network, person, config, seed)
            elif variant != "nothing":
                told = person if variant == "all" else nobody
                course = load_map(options.map), looks
                teach(network, contract, course, told, config, seed, shown)
            export_network(network, contract, out / "model.onnx")
            maps = (options.map, *options.elsewhere)
            found = {at: succeeded(out / "model.onnx", at, look, options.drives) for at in maps}
            yield {
                "floor": name,
                "variant": variant,
                "seed": seed,
                "drives": options.drives,
                **found,
            }


def main() -> int:
    """Compare."""
    parser = OneLineParser(prog="python -m tests.trainer.compare_teach", description=__doc__)
    parser.add_argument("--base", default="lane_dueling", help="an ONNX file or a shipped policy")
    parser.add_argument("--floors", nargs="+", default=["lab_nominal"], help="of judge_teach")
    parser.add_argument("--map", default="rings/claw", help="of the ring that is driven")
    parser.add_argument(
        "--elsewhere", nargs="*", default=["rings/fish"], help="rings judged on, too"
    )
    parser.add_argument("--seconds", type=number(20, 1200), default=180.0, help="of each drive")
    parser.add_argument("--drives", type=whole(1, 1000), default=50, help="of two laps, on each")
    parser.add_argument("--steps", type=whole(2, 10**6), default=900, help="of teaching")
    told = "of the CycleGAN and of the parser; what translates through it takes a fifth"
    parser.add_argument("--updates", type=whole(2, 10**6), default=UPDATES, help=told)
    parser.add_argument("--seeds", type=whole(1, 100), default=3, help="of teaching")
    parser.add_argument("--json", type=Path, required=True, help="write the figures, and go on")
    options = parser.parse_args()
    torch.set_num_threads(1)
    rows = read_json(options.json)["rows"] if options.json.exists() else []
    done = {(row["floor"], row["variant"], row["seed"]) for row in rows}
    with tempfile.TemporaryDirectory() as folder:
        for row in compare(options, Path(folder), done):
            rows.append(row)
            print(", ".join(f"{k} {v}" for k, v in row.items()), flush=True)
            write_json(options.json, {"rows": rows})
    return 0


if __name__ == "__main__":
    sys.exit(main())
