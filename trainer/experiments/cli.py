"""The commands ``experiment …``, and what they can be asked for; imports nothing heavy."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console

from trainer.options import WorkerOptions
from trainer.sweeps.sweep import run_sweep

MAPS = ("hamlet", "village", "suburb", "blocks")  # not the arena, where the six models are judged


@dataclass(frozen=True)
class SixModelsOptions:
    """What is trained, and where it is judged."""

    translator: str | None = None  # An ONNX translator sim-to-real; else no CycleGAN model.
    preset: str = "fast"  # paper, fast or debug.
    map: tuple[str, ...] = MAPS  # Maps of the navigation trainings.
    test_map: str = "arena"  # Map of the paths and missions.
    look: str = "reality"  # Look or looks in which all are judged.
    pose_error: str = "arena"  # In training and test alike: none or arena.
    steps: int = 400_000  # Of each navigation training by Dueling.
    ppo_steps: int = 800_000  # Of each by PPO, whose steps cost a third; as in the paper.
    lane_steps: int = 60_000  # Of each lane training.
    judgings: int = 4  # How often each is judged while it is trained; the best is kept.
    lap_drives: int = 20  # Drives of four laps of each lane keeper.
    seeds: int = 3  # Models of each kind, with seeds 0, 1, 2 …


@dataclass(frozen=True)
class Figure5Options:
    """What is trained, where, and how long."""

    algo: str = "ppo"  # ppo, a2c or a3c.
    preset: str = "fast"  # paper, fast or debug.
    map: str = "airfield"  # The track of all trainings but the Oracle's.
    look: str = "tracks/day"  # The look of the trainings on it.
    looks: str = "tracks"  # The looks of domain randomisation.
    test_map: str = "speedway"  # The track on which all are judged.
    test_look: str = "tracks_unseen/steppe"  # In which all are judged; not one of ``looks``.
    steps: int = 100_000  # Decisions of each training.
    seeds: int = 3  # Trainings of each kind, with seeds 0, 1, 2 …
    frames: int = 1000  # From which each half of the translator learns; the paper has 15,000.
    translator_steps: int = 1500  # Updates of each half.


@dataclass(frozen=True)
class Table1Options:
    """Which drive, and who foretells it."""

    data: Path  # A Donkeycar tub, Sully Chen's folder, or pictures with labels.csv.
    # name=model.onnx: ours=... (trained in translated pictures), b-rl=... (trained in the
    # simulator's own), or any other name; a name again is another seed.
    policy: tyro.conf.UseAppendAction[tuple[str, ...]] = ()
    rate_hz: float = 20.0  # Pictures of the drive in a second; policies see some 0.1 s apart.
    seeds: int = 3  # How many supervised networks of each kind.
    steps: int = 400  # Updates of each.


def table1_command(out: Path, options: Annotated[Table1Options, tyro.conf.arg(name="")]) -> int:
    """Foretell left, straight or right on a person's recorded drive: paper B, Table 1.

    The supervised network learns from the first 60 % of the drive; all are tested on what comes
    20 frames later. Called again, it goes on where it was cut off.

    Args:
        out: folder for table1.json, table1.png and the networks.
    """
    from robot.output import write_json
    from trainer.experiments.table1 import as_table, draw_table, foretell

    console = Console(soft_wrap=True)
    table = foretell(out, options, console)
    write_json(out / "table1.json", table)
    draw_table(table, out / "table1.png")
    console.print(as_table(table))
    return 0


def six_models_command(
    out: Path,
    options: Annotated[SixModelsOptions, tyro.conf.arg(name="")],
    workers: Annotated[WorkerOptions, tyro.conf.arg(name="")],
) -> int:
    """Compare Dueling DQN and PPO with nothing, randomisation, CycleGAN and both: paper A, 4.4.

    Seed by seed, with the tables after each. Called again, it goes on where it was cut off; what is
    finished is not done again.

    Args:
        out: folder for the runs, six_models.json, six_models.md and six_models.png (learning).
    """
    from robot.inference.policy import OnnxTranslator
    from trainer.experiments.six_models import drives, kinds, report, trainings, trials

    console = Console(soft_wrap=True)
    if options.translator:
        OnnxTranslator(options.translator)  # refused before anything is written
    for trial in trials(options).values():
        replace(trial, model="model.onnx").check()  # likewise
    for seed in range(options.seeds):
        among = [kind[seed] for kind in kinds(options)]
        for jobs in (trainings(out, options, among), drives(out, options, among)):
            if status := run_sweep(jobs, workers, console):
                return status
        console.print(report(out, replace(options, seeds=seed + 1)), markup=False)
    return 0


def figure5_command(
    out: Path,
    options: Annotated[Figure5Options, tyro.conf.arg(name="")],
    workers: Annotated[WorkerOptions, tyro.conf.arg(name="")],
) -> int:
    """Compare an Oracle, translation through parsing, randomisation and neither: paper B, 3.2.

    Called again, it goes on where it was cut off; with more --steps or --seeds it adds to what
    is there. A3C uses all cores: ask for --workers 1.

    Args:
        out: folder for frames, translator, runs, figure5.json and figure5.png.
    """
    from robot.output import write_json
    from robot.typed_config import to_plain
    from trainer.experiments.figure5 import as_table, draw_figure, gather, trainings, translator

    console = Console(soft_wrap=True)
    for job in trainings(out, options, out / "translator" / "sim_to_real.onnx"):
        job.finished()  # refused before anything is gathered
    jobs = trainings(out, options, translator(out, options, console))
    if status := run_sweep(jobs, workers, console):
        return status
    curves = gather(out, options)
    told = {"options": to_plain(options), "curves": to_plain(curves), "schema": 1}
    write_json(out / "figure5.json", told)
    draw_figure(options, curves, out / "figure5.png")
    console.print(as_table(options, curves))
    return 0
