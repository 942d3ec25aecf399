"""Look at everything that the robot needs, and say what to do about what is wrong.

Nothing moves and nothing is written to any device. Exit status 1 when something FAILs.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import List

from robot.doctor.findings import Finding, Level
from robot.doctor.machine import ThisMachine
from robot.doctor.report import examine
from robot.output import expect_writable, write_json


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The command's options."""
    parser.add_argument("--config", type=Path, help="the robot's YAML file")
    parser.add_argument("--json", type=Path, help="file to write")
    parser.add_argument(
        "--place", type=Path, default=Path("."), help="where recordings are written"
    )


def run(options: argparse.Namespace) -> int:
    """Do it; 1 when something fails."""
    expect_writable(options.json, inputs=[options.config])
    findings: List[Finding] = []
    for finding in examine(ThisMachine(), options.config):
        findings.append(finding)
        print(finding.line, flush=True)
    counts = {level: sum(f.level is level for f in findings) for level in Level}
    print(", ".join(f"{count} {level.value}" for level, count in counts.items()))
    if options.json:
        inputs = {"config": str(options.config) if options.config else None}
        told = [{**finding._asdict(), "level": finding.level.value} for finding in findings]
        write_json(options.json, {"schema": 1, "inputs": inputs, "findings": told})
    return int(counts[Level.FAIL] > 0)
