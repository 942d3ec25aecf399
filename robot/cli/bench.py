"""Measure this computer as a robot: decisions, imports and memory, the loop's punctuality."""

from __future__ import annotations

import argparse
import os
import platform
from dataclasses import asdict
from pathlib import Path

from robot.command_line import number
from robot.inference.policy import OnnxPolicy, time_decisions
from robot.output import expect_writable, write_json
from robot.runtime.dry_run import measure


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The command's options."""
    parser.add_argument("--model", type=Path, required=True, help="an ONNX policy")
    parser.add_argument("--json", type=Path, help="file to write")
    seconds = number(0.5, 3600.0)
    parser.add_argument("--seconds", type=seconds, default=5.0, help="how long the loop runs")


def run(options: argparse.Namespace) -> None:
    """Do it; DuckpilotError for a wrong model."""
    expect_writable(options.json, inputs=[options.model])
    decision = time_decisions(OnnxPolicy(options.model))
    print(f"decision    p50 {decision.p50_ms:.2f} ms, p99 {decision.p99_ms:.2f} ms (one thread)")
    found = measure(options.model, options.seconds)
    robot, loop = found["robot"], found["loop"]
    print(f"robot       imports {robot['import_s']:.2f} s, resident {robot['rss_mb']:.0f} MB")
    print(
        f"loop        late p50 {loop['lag_p50_ms']:.2f} ms, p99 {loop['lag_p99_ms']:.2f} ms, "
        f"most {loop['lag_max_ms']:.2f} ms; turn p50 {loop['turn_p50_ms']:.2f} ms"
    )
    if options.json:
        machine = {"machine": platform.machine(), "cpus": os.cpu_count()}
        asked = {"model": str(options.model), "seconds": options.seconds}
        inputs = {**asked, **machine, "python": platform.python_version()}
        report = {"schema": 1, "inputs": inputs, "inference": asdict(decision), **found}
        write_json(options.json, report)
