"""Measure this computer as a robot: decisions, imports and memory, the loop's punctuality."""

from __future__ import annotations

import argparse
import os
import platform
from dataclasses import asdict
from pathlib import Path
from typing import Dict, List

import numpy as np

from robot.command_line import number
from robot.computer.clock import MonotonicClock
from robot.computer.footprint import measure_footprint
from robot.contract import CONTROL_DT_S
from robot.inference.policy import OnnxPolicy, time_decisions
from robot.output import expect_writable, write_json
from robot.parts import Tick
from robot.runtime.dry_run import dry_runtime
from robot.runtime.timing import RateKeeper


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
    footprint = measure_footprint(options.model)
    print(f"robot       imports {footprint.import_s:.2f} s, resident {footprint.rss_mb:.0f} MB")
    loop = time_loop(options.model, options.seconds)
    print(
        f"loop        late p50 {loop['lag_p50_ms']:.2f} ms, p99 {loop['lag_p99_ms']:.2f} ms, "
        f"most {loop['lag_max_ms']:.2f} ms; turn p50 {loop['turn_p50_ms']:.2f} ms"
    )
    if options.json:
        machine = {"machine": platform.machine(), "cpus": os.cpu_count()}
        asked = {"model": str(options.model), "seconds": options.seconds}
        inputs = {**asked, **machine, "python": platform.python_version()}
        result = {"inference": asdict(decision), "robot": asdict(footprint), "loop": loop}
        write_json(options.json, {"schema": 1, "inputs": inputs, **result})


def time_loop(model: Path, seconds: float) -> Dict[str, float]:
    """Run the loop on made-up pictures, on time, with motors that do nothing.

    Returns:
        How late turns began, and how long they took from camera to wheels [ms].
    """
    runtime = dry_runtime(model)
    rate = RateKeeper(CONTROL_DT_S, MonotonicClock())
    ticks: List[Tick] = [runtime.step(rate.wait()) for _ in range(round(seconds / CONTROL_DT_S))]
    lags = np.percentile([1e3 * tick.lag_s for tick in ticks], (50, 99, 100)).tolist()
    turns = np.percentile([1e3 * tick.duration_s for tick in ticks], (50, 99)).tolist()
    names = ("lag_p50_ms", "lag_p99_ms", "lag_max_ms", "turn_p50_ms", "turn_p99_ms")
    return {"turns": len(ticks), **dict(zip(names, lags + turns))}
