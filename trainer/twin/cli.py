"""``duckpilot fit``: a twin from recordings; ``duckpilot teach``: a policy for it."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import tyro
from rich.console import Console
from rich.progress import Progress

from robot.errors import ConfigError
from robot.output import expect_writable


def fit_command(
    recordings: tyro.conf.Positional[tuple[Path, ...]], out: Path = Path("my_look.yaml")
) -> int:
    """Fit a twin of robot, camera and floor to one to three minutes of driving.

    Leaves a look to train in, and a page beside it that shows recorded pictures and the twin's.

    Args:
        recordings: MCAP files of drives on one map, best with overhead poses.
    """
    if _fit(recordings, out, Console(soft_wrap=True, highlight=False))[2] is None:
        raise ConfigError("fit: expected recordings of drives on a map, got drives without one")
    return 0


def _fit(recordings: tuple[Path, ...], out: Path, console: Console) -> tuple[Any, Any, Any]:
    """The drives, where the robot was at their pictures, and their map; without one no twin."""
    from trainer.processes import pool
    from trainer.twin.fit import fit_twin, write_twin, write_twin_page
    from trainer.twin.recorded import read_drives

    expect_writable(out, out.with_suffix(".html"), inputs=recordings)
    drives = read_drives(recordings, lambda line: console.print(line, markup=False))
    if not any(drive.map_name for drive in drives):
        return drives, [None] * len(drives), None
    with console.status("fitting"), pool() as spread:
        twin = fit_twin(drives, spread)
    write_twin(twin, out)
    write_twin_page(twin, drives[0], page := out.with_suffix(".html"))
    for name, (value, sd) in twin.found.items():
        if not isinstance(value, list):
            console.print(f"{name:24} {value:9.4g} ± {2.0 * sd:.2g}", markup=False)
    console.print("\n".join((*twin.unseen, f"{out}; {page}")), markup=False)
    return drives, twin.places, drives[0].road_map


def teach_command(
    recordings: tyro.conf.Positional[tuple[Path, ...]],
    base: str = "lane_sight",
    out: Path = Path("my_policy"),
    drives: int = 100,
    steps: int | None = None,
    cyclegan: int = 0,
    seed: int = 0,
) -> int:
    """Teach a policy your floor: fit a twin, learn on in it, and prove it there.

    Leaves twin.yaml, twin.html and model.onnx in its folder; without a map it learns your steering.
    Exit status 1 if no robot may arm by the proof, or its base drives better.

    Args:
        recordings: MCAP files of drives on one map, or without any.
        base: what it learns on from: an ONNX file, or the name of a shipped policy.
        drives: in the twin, for the proof.
        steps: of learning; else 2,700, without a map 900.
        cyclegan: updates of a CycleGAN from twin to recordings, which then shows it; 0: none.
        seed: of everything random.
    """
    from sim_pybullet.randomise import load_look_sampler
    from trainer.export import export_network
    from trainer.learners.backbone import Backbone
    from trainer.twin.examples import examples_of
    from trainer.twin.proof import prove
    from trainer.twin.teach import base_file, how_much, load_base, new_model, pose_error, teach
    from trainer.twin.translation import twin_to_real

    console, path = Console(soft_wrap=True, highlight=False), base_file(base)
    (network, contract), model = load_base(path), new_model(out)
    seen, places, road_map = _fit(recordings, out / "twin.yaml", console)
    person, held_out = (examples_of(seen, places, contract, late) for late in (False, True))
    able = isinstance(network.features.convolutions, Backbone) and not contract.path_points
    if not road_map and (cyclegan or not able or not len(person.shares)):
        wanted = "without a map: expected your driving, base lane_sight, no --cyclegan"
        raise ConfigError(f"{wanted}; got {len(person.shares)} pictures, {path.stem}, {cyclegan}")
    twin = road_map and (road_map, load_look_sampler(out / "twin.yaml", pose_error(contract)))
    options = how_much(bool(twin), steps)
    how = contract.image, out, cyclegan, seed, console
    shown = twin_to_real(recordings, *how) if cyclegan else None
    with console.status("teaching"):
        teach(network, contract, twin, person, options, seed, shown)
    count = contract.trained_steps + (2 if twin else 1) * options.steps * options.robots
    taught = replace(contract, run=out.name, taught_from=path.stem, trained_steps=count, score=None)
    export_network(network, taught, model)
    with Progress(console=console) as bar:
        row = bar.add_task("proof", total=2 * drives)
        given = twin, held_out, drives, lambda _: bar.advance(row)
        before, proof = (prove(file, *given) for file in (path, model))
    export_network(network, proven := replace(taught, proof=proof), model)
    console.print(f"before: {before.sentence}\n{model}: {proof.sentence}", markup=False)
    if worse := proof.succeeded < before.succeeded:
        console.print(f"it drives worse than {path.stem}: keep that", markup=False)
    if proven.unproven:
        console.print(f"the robot will not arm with it: {proven.unproven}", markup=False)
    return 1 if worse or proven.unproven else 0
