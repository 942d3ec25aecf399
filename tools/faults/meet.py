"""Meets the faults that were asked for, one after the other."""

import tempfile
from dataclasses import replace
from itertools import groupby
from pathlib import Path

import cv2
from rich.progress import MofNCompleteColumn, Progress

from robot.cli.install import SHIPPED_MODEL as LANE_KEEPER
from robot.errors import ConfigError, expect_one_of
from robot.inference.policy import SHIPPED_MODELS
from robot.output import expect_writable, write_json
from robot.typed_config import from_plain, read_json, to_plain
from robot.vision.sight import OnnxSight
from tools.faults import machines, senses, strangers, traffic
from tools.faults.case import FAMILIES, TABLE, Case, Outcome, case_of
from tools.faults.cli import FaultsOptions
from tools.faults.report import write_report
from tools.faults.stage import Stage
from tools.loop.bench import BenchOptions
from tools.loop.drive import expect_navigator


def every_case() -> list[Case]:
    """All cases, in order."""
    modules = (senses, machines, strangers, traffic)
    known = {name: value for module in modules for name, value in vars(module).items()}
    return [case_of(family, row, known) for family in FAMILIES for row in TABLE[family]]


def chosen(options: FaultsOptions) -> list[Case]:
    """The cases asked for, by sight alone those without poses. ConfigError: no such case."""
    for wanted in options.family:
        expect_one_of("--family", wanted, FAMILIES)
    every = [case for case in every_case() if case.family in (options.family or FAMILIES)]
    names = {case.name for case in every}
    for wanted in options.case:
        expect_one_of("--case", wanted, names)
    asked = [case for case in every if not options.case or case.name in options.case]
    if not options.sight:
        return asked
    return [
        replace(case, threshold_s=case.by_sight_s or case.threshold_s)
        for case in asked
        if not case.poses
    ]


def meet(options: FaultsOptions) -> int:
    """Meet the faults asked for; 0 when the robot did right in all, 1 otherwise."""
    expect_writable(options.json, options.report, inputs=[options.model, options.sight])
    cases = chosen(options)
    expect_navigator(options.model)
    if options.sight:
        OnnxSight(options.sight)
    outcomes = _done(options.json)
    cv2.setNumThreads(1)
    _play(cases, outcomes, options)
    if options.report:
        met = {(outcome.family, outcome.name) for outcome in outcomes}
        named = [(case.family, case.name) for case in chosen(replace(options, family=(), case=()))]
        write_report(outcomes, options.report, [" ".join(n) for n in named if n not in met])
    failed = [outcome for outcome in outcomes if outcome.problem]
    for outcome in failed:
        print(f"{outcome.family}, {outcome.name}: {outcome.problem}")
    print(f"{len(outcomes) - len(failed)} of {len(outcomes)} faults met as they must be")
    return 1 if failed else 0


def _play(cases: list[Case], outcomes: list[Outcome], options: FaultsOptions) -> None:
    """Those without an outcome yet, each family on a bench of its own."""
    done = {(outcome.family, outcome.name) for outcome in outcomes}
    todo = [case for case in cases if (case.family, case.name) not in done]
    common = BenchOptions(options.model, seed=options.seed, record=True, sight=options.sight)
    alone = replace(common, localizer=not options.sight)
    among = replace(common, among=True)
    sight = SHIPPED_MODELS / "sight.onnx"
    keeper = replace(among, map="loop", model=LANE_KEEPER, sight=sight, leader=options.model)
    benches = {"traffic": among, "by sight": keeper}
    with Progress(*Progress.get_default_columns(), MofNCompleteColumn()) as bar:
        task = bar.add_task("faults", total=len(cases), completed=len(cases) - len(todo))
        for family, rows in groupby(todo, lambda case: case.family):
            with (
                tempfile.TemporaryDirectory(prefix="duckpilot-faults-") as folder,
                Stage(benches.get(family, alone), Path(folder)) as stage,
            ):
                for case in rows:
                    bar.update(task, description=f"{case.family}: {case.name}")
                    outcomes.append(stage.play(case))
                    if options.json:
                        write_json(options.json, {"schema": 1, "outcomes": to_plain(outcomes)})
                    bar.advance(task)


def _done(path: Path | None) -> list[Outcome]:
    if path is None or not path.exists():
        return []
    rows = read_json(path).get("outcomes")
    if not isinstance(rows, list):
        raise ConfigError(f"{path}: expected the outcomes of an earlier run, got others")
    return [from_plain(Outcome, row, f"{path}: outcomes") for row in rows]
