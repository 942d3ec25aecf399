"""``python -m tools.faults``: every fault in the loop with the real processes; a table.

In lock-step by default: the same on every machine, and times are those of the robot's own clock,
without what a slow computer adds. ``--realtime`` measures by the wall clock.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from dataclasses import asdict
from pathlib import Path

import cv2
from tqdm import tqdm

from robot.command_line import SEED, OneLineParser, answer
from robot.errors import ConfigError, DuckpilotError, nearest
from robot.output import expect_writable, write_json
from tools.faults import (
    camera,
    i2c,
    localizer,
    missions,
    models,
    network,
    pictures,
    programs,
    recording,
    strangers,
    ways,
)
from tools.faults.case import Case, Outcome
from tools.faults.report import write_report
from tools.faults.stage import Stage
from tools.loop.bench import BenchOptions
from tools.loop.drive import expect_navigator, read_figures
from tools.loop.timekeeper import BenchError

FAMILIES: dict[str, tuple[Case, ...]] = {
    "camera": camera.CASES,
    "pictures": pictures.CASES,
    "I2C": i2c.CASES,
    "model": models.CASES,
    "localizer": localizer.CASES,
    "programs": programs.CASES,
    "network": network.CASES,
    "strangers": strangers.CASES,
    "missions": missions.CASES,
    "ways": ways.CASES,
    "recording": recording.CASES,
}


def parse(arguments: list[str] | None) -> argparse.Namespace:
    """The command line."""
    parser = OneLineParser(prog="python -m tools.faults", description=__doc__)
    parser.add_argument("--model", type=Path, required=True, help="ONNX policy for navigation")
    parser.add_argument("--family", action="append", choices=list(FAMILIES), help="only these")
    parser.add_argument("--case", action="append", help="only these, by name")
    parser.add_argument("--realtime", action="store_true", help="by the wall clock")
    parser.add_argument("--seed", type=SEED, default=0)
    parser.add_argument("--json", type=Path, help="write the outcomes; goes on from there")
    parser.add_argument("--report", type=Path, help="write the table, such as docs/faults.md")
    return parser.parse_args(arguments)


def chosen(options: argparse.Namespace) -> list[tuple[str, Case]]:
    """The cases asked for, with their families.

    Raises:
        DuckpilotError: no such case.
    """
    families = options.family or list(FAMILIES)
    every = [(family, case) for family in families for case in FAMILIES[family]]
    names = {case.name for _, case in every}
    for wanted in options.case or ():
        if wanted not in names:
            raise DuckpilotError(f"no case {wanted!r}; {nearest(wanted, sorted(names))}")
    return [row for row in every if not options.case or row[1].name in options.case]


def main(arguments: list[str] | None = None) -> int:
    """Exit status 0 when the robot did right in every case, 2 for wrong input, 1 otherwise."""
    options = parse(arguments)
    return answer("faults", lambda: meet(options))


def meet(options: argparse.Namespace) -> int:
    """Meet the faults asked for; 0 when the robot did right in all, 1 otherwise."""
    expect_writable(options.json, options.report, inputs=[options.model])
    cases = chosen(options)
    expect_navigator(options.model)
    outcomes = _done(options.json)
    cv2.setNumThreads(1)
    try:
        with tempfile.TemporaryDirectory(prefix="duckpilot-faults-") as folder:
            _play(cases, outcomes, options, Path(folder))
    except BenchError as error:
        print(f"faults: {error}", file=sys.stderr)
        return 1
    if options.report:
        met = {(outcome.family, outcome.name) for outcome in outcomes}
        every = [(family, case.name) for family, cases in FAMILIES.items() for case in cases]
        unmet = [f"{family} {name}" for family, name in every if (family, name) not in met]
        write_report(outcomes, options.report, unmet)
    failed = [outcome for outcome in outcomes if not outcome.passed]
    for outcome in failed:
        print(f"{outcome.family}, {outcome.name}: {outcome.problem}")
    print(f"{len(outcomes) - len(failed)} of {len(outcomes)} faults met as they must be")
    return 1 if failed else 0


def _play(
    cases: list[tuple[str, Case]],
    outcomes: list[Outcome],
    options: argparse.Namespace,
    folder: Path,
) -> None:
    done = {(o.family, o.name) for o in outcomes}
    todo = [(family, case) for family, case in cases if (family, case.name) not in done]
    if not todo:
        return
    bench = BenchOptions(
        options.model, seed=options.seed, lockstep=not options.realtime, record=True
    )
    with Stage(bench, folder) as stage, tqdm(total=len(cases), initial=len(done)) as bar:
        for family, case in todo:
            bar.set_description(f"{family}: {case.name}")
            outcomes.append(stage.play(family, case))
            _write(options.json, outcomes)
            bar.update()


def _done(path: Path | None) -> list[Outcome]:
    if path is None or not path.exists():
        return []
    try:
        return [Outcome(**row) for row in read_figures(path)["outcomes"]]
    except (KeyError, TypeError) as error:
        raise ConfigError(f"{path}: expected the outcomes of an earlier run, got others") from error


def _write(path: Path | None, outcomes: list[Outcome]) -> None:
    if path is not None:
        write_json(path, {"schema": 1, "outcomes": [asdict(outcome) for outcome in outcomes]})


if __name__ == "__main__":
    sys.exit(main())
