"""Meets the faults that were asked for, one after the other."""

from __future__ import annotations

import argparse
import tempfile
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import cv2
from tqdm import tqdm

from robot.cli.install import SHIPPED_MODEL as LANE_KEEPER
from robot.errors import ConfigError, DuckpilotError, nearest
from robot.inference.policy import SHIPPED_MODELS
from robot.output import expect_writable, write_json
from robot.safety.governors import Rules
from robot.typed_config import read_json
from tools.faults import FAMILIES, hardware, pictures, poses, programs, strangers, traffic
from tools.faults.case import Case, Outcome
from tools.faults.report import write_report
from tools.faults.stage import Stage
from tools.loop.bench import BenchOptions
from tools.loop.drive import expect_navigator


def every_case() -> list[tuple[str, Case]]:
    """All cases with their families, in order."""
    modules = (pictures, hardware, poses, programs, strangers, traffic)
    cases = {family: rows for module in modules for family, rows in module.CASES.items()}
    return [(family, case) for family in FAMILIES for case in cases[family]]


def chosen(options: argparse.Namespace) -> list[tuple[str, Case]]:
    """The cases asked for, with their families. DuckpilotError: no such case."""
    families = options.family or list(FAMILIES)
    every = [row for family in families for row in every_case() if row[0] == family]
    names = {case.name for _, case in every}
    for wanted in options.case or ():
        if wanted not in names:
            raise DuckpilotError(f"no case {wanted!r}; {nearest(wanted, sorted(names))}")
    return [row for row in every if not options.case or row[1].name in options.case]


def meet(options: argparse.Namespace) -> int:
    """Meet the faults asked for; 0 when the robot did right in all, 1 otherwise."""
    expect_writable(options.json, options.report, inputs=[options.model])
    cases = chosen(options)
    expect_navigator(options.model)
    outcomes = _done(options.json)
    cv2.setNumThreads(1)
    _play(cases, outcomes, options)
    if options.report:
        met = {(outcome.family, outcome.name) for outcome in outcomes}
        unmet = [f"{f} {case.name}" for f, case in every_case() if (f, case.name) not in met]
        write_report(outcomes, options.report, unmet)
    failed = [outcome for outcome in outcomes if not outcome.passed]
    for outcome in failed:
        print(f"{outcome.family}, {outcome.name}: {outcome.problem}")
    print(f"{len(outcomes) - len(failed)} of {len(outcomes)} faults met as they must be")
    return 1 if failed else 0


def _play(
    cases: list[tuple[str, Case]], outcomes: list[Outcome], options: argparse.Namespace
) -> None:
    done = {(o.family, o.name) for o in outcomes}
    todo = [(family, case) for family, case in cases if (family, case.name) not in done]
    if not todo:
        return
    alone = BenchOptions(options.model, seed=options.seed, record=True, sight=options.sight)
    among = replace(alone, among=True, rules=Rules(headway=True))
    sight = SHIPPED_MODELS / "sight.onnx"
    keeper = replace(among, map="loop", model=LANE_KEEPER, sight=sight, leader=options.model)
    benches = {"traffic": among, "by sight": keeper}
    with tqdm(total=len(cases), initial=len(done)) as bar:
        for bench in (alone, among, keeper):
            rows = [row for row in todo if benches.get(row[0], alone) is bench]
            if rows:
                _play_on(bench, rows, outcomes, options, bar)


def _play_on(
    bench: BenchOptions,
    cases: list[tuple[str, Case]],
    outcomes: list[Outcome],
    options: argparse.Namespace,
    bar: tqdm[Any],
) -> None:
    with (
        tempfile.TemporaryDirectory(prefix="duckpilot-faults-") as folder,
        Stage(bench, Path(folder)) as stage,
    ):
        for family, case in cases:
            bar.set_description(f"{family}: {case.name}")
            outcomes.append(stage.play(family, case))
            if options.json:
                rows = [asdict(outcome) for outcome in outcomes]
                write_json(options.json, {"schema": 1, "outcomes": rows})
            bar.update()


def _done(path: Path | None) -> list[Outcome]:
    if path is None or not path.exists():
        return []
    try:
        return [Outcome(**row) for row in read_json(path)["outcomes"]]
    except (KeyError, TypeError) as error:
        raise ConfigError(f"{path}: expected the outcomes of an earlier run, got others") from error
