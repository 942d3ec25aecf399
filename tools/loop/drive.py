"""The whole system drives missions on the bench.

A world process holds town, wheels, HAT and cameras; robot, localizer and monitor are the programs
as they are, over encrypted links; missions are clicked, in effect, on the monitor's page.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import tempfile
import time
from contextlib import ExitStack
from dataclasses import asdict
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from tqdm import tqdm

from robot.errors import ConfigError, ContractError
from robot.inference.policy_file import read_contract
from robot.navigation.road_map import load_map
from robot.output import expect_writable, write_json
from tools.loop.bench import Bench, BenchOptions
from tools.loop.film import Film
from tools.loop.missions import Driver, MissionRecord
from tools.loop.sites import Site, sites_of
from tools.loop.timekeeper import BenchError

SCHEMA = 2


def drive(options: argparse.Namespace) -> int:
    """Drive as asked and say how it went; 0 when every mission arrived, 1 otherwise."""
    cv2.setNumThreads(1)
    try:
        with tempfile.TemporaryDirectory(prefix="duckpilot-loop-") as folder:
            figures = run(options, Path(folder))
    except BenchError as error:
        print(f"loop: {error}", file=sys.stderr)
        return 1
    print(
        f"{figures['arrived']} of {figures['missions']} missions arrived, "
        f"{figures['driven_m']:.0f} m in {figures['seconds']:.0f} s, "
        f"{figures['speed']:.2f} times as fast as real time"
    )
    return 0 if figures["arrived"] == options.missions else 1


def run(options: argparse.Namespace, folder: Path) -> dict[str, Any]:
    """Drive the missions that ``--json`` does not hold yet; the figures of all."""
    expect_writable(options.json, options.video, inputs=[options.model])
    expect_navigator(options.model)
    load_map(options.map)  # refused before a bar is drawn
    site_after = sites_of(options.look, options.seed)
    rows = _rows_so_far(options)
    if len(rows) == options.missions:
        return summary(rows, options)
    trip = Trip(options, rows)
    with ExitStack() as stack:
        film = Film(options.video, options.model) if options.video else None
        if film is not None:
            stack.callback(film.close)
        stack.callback(trip.bar.close)
        while len(rows) < options.missions:
            robot = _drive_at(site_after(len(rows)), trip, folder, film)
    figures = {**summary(rows, options), "robot": robot}
    _write(options.json, figures)
    return figures


class Trip:
    """What was asked and what was driven so far; ``rows`` are those of the JSON."""

    def __init__(self, options: argparse.Namespace, rows: list[dict[str, Any]]) -> None:
        self.options, self.rows = options, rows
        self.bar = tqdm(total=options.missions, initial=len(rows), desc="missions")

    def add(self, figures: dict[str, Any]) -> None:
        """One more mission, written at once."""
        self.rows.append(figures)
        _write(self.options.json, summary(self.rows, self.options))
        self.bar.update()


def _drive_at(site: Site, trip: Trip, folder: Path, film: Film | None) -> dict[str, Any]:
    """Begin a bench at a site and drive until the robot leaves it; the robot's figures."""
    options, driven = trip.options, len(trip.rows)
    bench = Bench(_bench_options(options, site, driven), folder / str(driven))
    rng = np.random.default_rng((options.seed, driven))
    driver = Driver(bench, rng, (lambda: None) if film is None else lambda: film.watch(bench))
    start = driver.on_lane(*options.start) if options.start and not driven else driver.anywhere()
    bench.town.world.place(start)
    with bench:
        _drive(driver, site, trip)
        return {**bench.processes["robot"].figures, "lost_steps": list(bench.town.hat.lost_steps)}


def _bench_options(options: argparse.Namespace, site: Site, driven: int) -> BenchOptions:
    return BenchOptions(
        options.model,
        options.map,
        site.look,
        options.seed + driven,
        not options.realtime,
        robot_python=options.robot_python,
    )


def expect_navigator(model: Path) -> None:
    """ContractError unless this is a policy that follows missions."""
    contract = read_contract(model)
    if not contract.path_points:
        raise ContractError(
            f"{model}: expected a navigation policy, to follow missions, got a {contract.task} "
            "policy; "
            "give such as robot/models/nav_dueling.onnx"
        )


def _drive(driver: Driver, site: Site, trip: Trip) -> None:
    """Drive until the robot leaves the site or there is a row for every mission."""
    bench, rows = driver.bench, trip.rows
    until = min(trip.options.missions, site.until or trip.options.missions)
    began_s, lived_s = time.monotonic(), bench.now_s
    while len(rows) < until:
        record = driver.drive(trip.options.goal)
        figures = row(record, time.monotonic() - began_s, bench.now_s - lived_s)
        trip.add({"site": site.name, **figures})
        began_s, lived_s = time.monotonic(), bench.now_s
        if not record.arrived and len(rows) < until:
            driver.carry()


def row(record: MissionRecord, real_s: float, bench_s: float) -> dict[str, Any]:
    """One mission's line in the JSON."""
    errors = np.array(record.errors or [(math.nan, math.nan)])
    rms = np.sqrt(np.mean(errors**2, axis=0))
    offsets = np.array(record.offsets_m or [math.nan])
    return {
        "start": [round(float(v), 3) for v in record.start],
        "destination": [round(v, 3) for v in record.destination],
        "length_m": record.length_m,
        "arrived": record.arrived,
        "phase": record.phase,
        "reason": record.reason,
        "detours": record.detours,
        "stop": asdict(record.stop) if record.stop else None,
        "seconds": record.seconds,
        "missed_m": record.missed_m,
        "mean_path_distance_m": float(offsets.mean()),
        "max_path_distance_m": float(offsets.max()),
        "position_rms_m": float(rms[0]),
        "heading_rms_rad": float(rms[1]),
        "real_s": real_s,
        "bench_s": bench_s,
    }


def summary(rows: list[dict[str, Any]], options: argparse.Namespace) -> dict[str, Any]:
    """The JSON of all missions."""

    def mean(key: str) -> float:
        values = [r[key] for r in rows if math.isfinite(r[key])]
        return float(np.mean(values)) if values else math.nan

    return {
        "schema": SCHEMA,
        "inputs": inputs_of(options),
        "missions": len(rows),
        "arrived": sum(r["arrived"] for r in rows),
        "driven_m": sum(r["length_m"] for r in rows if r["arrived"]),
        "seconds": sum(r["seconds"] for r in rows),
        "speed": sum(r["bench_s"] for r in rows) / max(sum(r["real_s"] for r in rows), 1e-9),
        "mean_path_distance_m": mean("mean_path_distance_m"),
        "max_path_distance_m": max(
            (r["max_path_distance_m"] for r in rows if r["arrived"]), default=math.nan
        ),
        "position_rms_m": mean("position_rms_m"),
        "heading_rms_rad": mean("heading_rms_rad"),
        "detours": sum(r["detours"] for r in rows),
        "sites": arrivals_at(rows),
        "stops": [r["stop"] for r in rows if r["stop"]],
        "rows": rows,
    }


def arrivals_at(rows: list[dict[str, Any]]) -> dict[str, dict[str, int]]:
    """How many missions were driven in each look, and how many of them arrived."""
    sites: dict[str, dict[str, int]] = {}
    for one in rows:
        counts = sites.setdefault(one["site"], {"missions": 0, "arrived": 0})
        counts["missions"] += 1
        counts["arrived"] += one["arrived"]
    return sites


def _rows_so_far(options: argparse.Namespace) -> list[dict[str, Any]]:
    if options.json is None or not options.json.exists():
        return []
    before = read_figures(options.json)
    same = (before.get("schema"), before.get("inputs")) == (SCHEMA, inputs_of(options))
    return list(before.get("rows") or ())[: options.missions] if same else []


def read_figures(path: Path) -> dict[str, Any]:
    """The JSON object that an earlier run wrote.

    Raises:
        ConfigError: another file.
    """
    try:
        return dict(json.loads(path.read_text(encoding="utf-8")))
    except (OSError, ValueError, TypeError) as error:
        raise ConfigError(f"{path}: expected the JSON of an earlier run, got: {error}") from error


def inputs_of(options: argparse.Namespace) -> dict[str, Any]:
    """What the figures depend on."""
    names = ("map", "look", "seed", "realtime")
    places = {n: list(p) if (p := getattr(options, n)) else None for n in ("start", "goal")}
    return {"model": str(options.model), **{n: getattr(options, n) for n in names}, **places}


def _write(path: Path | None, figures: dict[str, Any]) -> None:
    if path is not None:
        write_json(path, figures)
