"""Measure this computer as a robot: decisions, imports and memory, the loop's punctuality."""

import argparse
import json
import os
import platform
import subprocess
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Dict

from robot.command_line import number
from robot.inference.policy import OnnxPolicy, time_decisions
from robot.output import expect_writable, write_json

CHILD = """import sys, time
began_s = time.perf_counter()
from robot.runtime.dry_run import tell
tell(began_s, *sys.argv[1:])"""


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


def measure(model: Path, seconds: float) -> Dict[str, Dict[str, float]]:
    """Start a fresh Python that imports every module of ours and drives for so long.

    ``robot``: seconds to import, greatest resident memory [MB]; ``loop``: how late turns began, and
    how long they took from camera to wheels [ms]. ContractError: the model keeps no contract.
    """
    OnnxPolicy(model)
    root = str(Path(__file__).resolve().parents[2])
    path = os.pathsep.join(filter(None, (root, os.environ.get("PYTHONPATH"))))
    done = subprocess.run(
        [sys.executable, "-c", CHILD, str(model), str(seconds)],
        check=True,
        stdout=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": path},
    )
    found: Dict[str, Dict[str, float]] = json.loads(done.stdout)
    return found
