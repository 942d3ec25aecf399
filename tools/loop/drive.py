"""The whole system drives missions on the bench, as many as were asked for.

By the policy, by an expert at the monitor's page, or by a person there who watches the policy.
"""

import json
import math
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from rich.progress import MofNCompleteColumn, Progress

from robot.contract import Stick
from robot.errors import ContractError
from robot.geometry import Pose
from robot.inference.policy import read_contract
from robot.navigation.path import Path as LanePath
from robot.navigation.planner import plan_path
from robot.navigation.road_map import load_map
from robot.output import expect_folder, expect_writable, write_json
from robot.recording.drive_file import picture
from robot.typed_config import read_json
from robot.vision.sight import OnnxSight
from tools.loop.bench import Bench, BenchOptions
from tools.loop.cli import LoopOptions
from tools.loop.missions import ANSWER_S, DAWDLE_MPS, Driver, MissionRecord, distance_m
from tools.loop.sites import Site, sites_of
from tools.video import DriveFilm, Moment

AHEAD_M = 0.2  # what a hand steers for
HARD_PER_M = 8.0  # curvature of a hard turn at full speed: 2.4 rad/s at 0.3 m/s
STANDS_S = 2.0  # before it drives off
STRAYED_M, BACK_M = 0.045, 0.02  # from its path: a person takes over, and hands over again
NOTICES_S = 0.3
LONGEST_S = 8.0  # of one help
THERE_M = 0.03  # before the end of a way
Whims = tuple[float, float]  # a share of full speed, and a curvature to steer besides [1/m]


class Aim(NamedTuple):
    """What a hand does now, and how far it is to the end of the way [m]."""

    stick: Stick
    left_m: float
    hint: int  # of where on the path it is, for the next time


def whim(time_s: float, phases: np.ndarray) -> Whims:
    """Of who shows a twin all, by four phases [rad].

    As docs/own-floor.md asks: stands for two seconds, then brakes, stops and weaves by jerks.
    """
    a, b, c, d = np.sin(np.array((0.9, 0.37, 1.9, 3.1)) * time_s + phases)
    speed = 0.0 if b > 0.97 else 1.0 if a > 0.3 else 0.8 if a > -0.5 else 0.57
    return speed * (time_s >= STANDS_S), float(1.4 * np.sign(c) + 0.8 * np.sign(d))


def aim(way: LanePath, pose: Pose, hint: int | None = None, whims: Whims = (1.0, 0.0)) -> Aim:
    """Steer for a point of a path, with `whim`; ``hint``: of `Path.project`.

    Pure pursuit (Coulter 1992), slower in bends.
    """
    at = way.project(pose.x_m, pose.y_m, hint)
    x_m, y_m = pose.to_robot(np.array(way.pose_at(at.arc_m + AHEAD_M)[:2]))
    bend = (2.0 * y_m / max(x_m * x_m + y_m * y_m, 1e-6) + whims[1]) / HARD_PER_M
    speed = whims[0] / (1.0 + abs(bend))
    stick = Stick(float(np.clip(bend * speed, -1.0, 1.0)), speed)
    return Aim(stick, way.length_m - at.arc_m, at.index)


class Expert(Driver):
    """Drives the whole way by hand, knowing where the robot truly is."""

    def drive(self, destination: tuple[float, float] | None = None) -> MissionRecord:
        """See `Driver`."""
        record = self._draw(destination)
        operator, bench = self.bench.operator, self.bench
        way = plan_path(self._graph, bench.town.pose, record.destination)
        self.rest()
        accepted, record.reason = operator.ask("arm")
        began_s, left_m, hint = bench.now_s, record.length_m, 0
        phases = self._rng.uniform(0.0, 2.0 * math.pi, 4)
        late_s = began_s + record.length_m / DAWDLE_MPS
        while accepted and left_m > THERE_M and bench.now_s < late_s:
            whims = whim(bench.now_s - began_s, phases)
            stick, left_m, hint = aim(way, bench.town.pose, hint, whims)
            operator.steer(stick)
            self._look()
            record.offsets_m.append(distance_m(way.points_m, bench.town.pose))
            if operator.state in ("HOLD", "FAULT"):
                record.reason, record.stop = operator.reason, self._standing()
                break
        record.phase = "arrived" if accepted and left_m <= THERE_M else "failed"
        operator.ask("disarm")
        record.seconds = bench.now_s - began_s
        record.missed_m = math.dist(bench.town.pose[:2], record.destination)
        return record


class Person(Driver):
    """Sends the policy, watches, takes over where it strays, and sends it again."""

    strayed_s = 0.0  # for how long by now

    def _look(self) -> str:
        phase, began_s = super()._look(), self.bench.now_s
        path = self.bench.operator.robot.get("path") or ()
        off_m = distance_m(path, self.bench.town.pose) if len(path) > 1 else 0.0
        if phase != "driving" or off_m < STRAYED_M:
            self.strayed_s = began_s
        if began_s - self.strayed_s < NOTICES_S:
            return phase
        goal = tuple(self.bench.operator.mission["destination"])
        way = LanePath.from_beziers([*np.linspace(path[:-1], path[1:], 4, axis=1)])
        while off_m > BACK_M and self.bench.now_s < began_s + LONGEST_S:
            self.bench.operator.steer(aim(way, self.bench.town.pose).stick)
            super()._look()
            off_m = distance_m(path, self.bench.town.pose)
        self.bench.operator.ask("mission", goal)
        self.strayed_s = self.bench.now_s
        while super()._look() != "driving" and self.bench.now_s < self.strayed_s + ANSWER_S:
            pass
        return str(self.bench.operator.mission.get("phase", ""))


DRIVERS = {"policy": Driver, "expert": Expert, "person": Person}
SCHEMA = 2
EVERY_S = 0.1  # between two pictures of a film


def drive(options: LoopOptions) -> int:
    """Drive as asked and say how it went; 0 when every mission arrived, 1 otherwise."""
    cv2.setNumThreads(1)
    with tempfile.TemporaryDirectory(prefix="duckpilot-loop-") as folder:
        figures = run(options, Path(folder))
    print(
        f"{figures['arrived']} of {figures['missions']} missions arrived, {figures['driven_m']:.0f}"
        f" m in {figures['seconds']:.0f} s, {figures['speed']:.2f} times as fast as real time"
    )
    return 0 if figures["arrived"] == options.missions else 1


def run(options: LoopOptions, folder: Path) -> dict[str, Any]:
    """Drive the missions that ``--json`` does not hold yet; the figures of all."""
    expect_writable(options.json, options.video, inputs=[options.policy])
    if options.record:
        expect_folder(options.record)
    expect_navigator(options.policy)
    load_map(options.road)  # refused before a bar is drawn
    if options.sight:
        OnnxSight(options.sight)
    site_after = sites_of(options.look, options.seed)
    rows, robot = rows_so_far(options), None
    with ExitStack() as stack:
        film = None
        if options.video and len(rows) < options.missions:
            film = DriveFilm(options.video, options.policy, EVERY_S)
            stack.callback(film.close)
        bar = stack.enter_context(Progress(*Progress.get_default_columns(), MofNCompleteColumn()))
        task = bar.add_task("missions", total=options.missions, completed=len(rows))
        done = lambda: bar.update(task, completed=len(rows))  # noqa: E731
        while len(rows) < options.missions:
            robot = _drive_at(site_after(len(rows)), options, rows, folder, film, done)
    figures = summary(rows, options)
    if robot and options.json:
        write_json(options.json, {**figures, "robot": robot})
    return figures


def expect_navigator(model: Path) -> None:
    """ContractError unless this is a policy that follows missions."""
    contract = read_contract(model)
    if not contract.path_points:
        raise ContractError(
            f"{model}: expected a navigation policy, to follow missions, got a {contract.task} "
            "policy; give such as robot/models/nav_dueling.onnx"
        )


def take_picture(film: DriveFilm, bench: Bench) -> None:
    """Film what the page shows now, and the truth."""
    bench.operator.look()
    if bench.operator.mission.get("phase") != "driving":
        film.map.trail.clear()
    if bench.operator.picture:
        film.add(moment(bench))


def moment(bench: Bench) -> Moment:
    """The newest report and picture that reached the page, beside the true pose."""
    operator = bench.operator
    seen = picture(operator.picture)
    robot, mission = operator.robot, operator.mission
    believed = Pose(*robot["pose"]) if robot.get("pose") else None
    note = f"{mission['remaining_m']:.1f} m to drive" if mission else ""
    path, values = (robot.get(name) or () for name in ("path", "values"))
    how = operator.state, operator.reason, path, values, robot.get("action"), note
    return Moment(seen, bench.town.pose, believed, *how)


def _drive_at(
    site: Site,
    options: LoopOptions,
    rows: list[dict[str, Any]],
    folder: Path,
    film: DriveFilm | None,
    done: Callable[[], None],
) -> dict[str, Any]:
    """Begin a bench at a site and drive until the robot leaves it; the robot's figures."""
    driven, until = len(rows), min(options.missions, site.until or options.missions)
    bench = Bench(
        BenchOptions(
            *(options.policy, options.road, site.look, options.seed + driven, not options.realtime),
            robot_python=options.robot_python,
            sight=options.sight,
            localizer=options.sight is None,
            record=options.record is not None,
            recordings=options.record,
        ),
        folder / str(driven),
    )
    driver = DRIVERS[options.driver](bench, np.random.default_rng((options.seed, driven)))
    first = None if driven else options.place("start")
    bench.town.world.place(driver.on_lane(*first) if first else driver.anywhere())
    with bench:
        if film is not None:
            film.turn_to(bench.town.world.scene.ground)
            bench.time.every(EVERY_S, partial(take_picture, film, bench))
        while len(rows) < until:
            began_s, lived_s = time.monotonic(), bench.now_s
            lost = len(rows) > driven and not rows[-1]["arrived"]
            if lost:
                driver.carry()
            if options.sight and (lost or len(rows) == driven):
                driver.find()
            record = driver.drive(options.place("goal"))
            figures = row(record, time.monotonic() - began_s, bench.now_s - lived_s)
            rows.append({"site": site.name, **figures})
            if options.json:
                write_json(options.json, summary(rows, options))
            done()
        if options.record:
            driver.rest()
        return {**bench.processes["robot"].figures, "lost_steps": list(bench.town.hat.lost_steps)}


def row(record: MissionRecord, real_s: float, bench_s: float) -> dict[str, Any]:
    """One mission's line in the JSON."""
    rms = np.sqrt(np.mean(np.square(record.errors or [(math.nan, math.nan)]), axis=0))
    offsets = np.array(record.offsets_m or [math.nan])
    told = asdict(record)
    del told["offsets_m"], told["errors"]
    return {
        **told,
        "arrived": record.arrived,
        "mean_path_distance_m": float(offsets.mean()),
        "max_path_distance_m": float(offsets.max()),
        "position_rms_m": float(rms[0]),
        "heading_rms_rad": float(rms[1]),
        "real_s": real_s,
        "bench_s": bench_s,
    }


def summary(rows: list[dict[str, Any]], options: LoopOptions) -> dict[str, Any]:
    """The JSON of all missions."""
    arrived = [r for r in rows if r["arrived"]]

    def mean(key: str) -> float:
        values = [v for r in rows if (v := r[key]) is not None and math.isfinite(v)]
        return float(np.mean(values)) if values else math.nan

    return {
        "schema": SCHEMA,
        "inputs": inputs_of(options),
        "missions": len(rows),
        "arrived": len(arrived),
        "driven_m": sum(r["length_m"] for r in arrived),
        "seconds": sum(r["seconds"] for r in rows),
        "speed": sum(r["bench_s"] for r in rows) / max(sum(r["real_s"] for r in rows), 1e-9),
        "max_path_distance_m": max((r["max_path_distance_m"] for r in arrived), default=math.nan),
        **{of: mean(of) for of in ("mean_path_distance_m", "position_rms_m", "heading_rms_rad")},
        "sites": arrivals_at(rows),
        "stops": [r["stop"] for r in rows if r["stop"]],
        "rows": rows,
    }


def arrivals_at(rows: list[dict[str, Any]]) -> dict[str, dict[str, int]]:
    """How many missions were driven in each look, and how many of them arrived."""
    driven = Counter(one["site"] for one in rows)
    arrived = Counter(one["site"] for one in rows if one["arrived"])
    return {site: {"missions": n, "arrived": arrived[site]} for site, n in driven.items()}


def rows_so_far(options: LoopOptions) -> list[dict[str, Any]]:
    """What an earlier run of the same inputs has driven."""
    if options.json is None or not options.json.exists():
        return []
    before = read_json(options.json)
    same = (before.get("schema"), before.get("inputs")) == (SCHEMA, inputs_of(options))
    return list(before.get("rows") or ())[: options.missions] if same else []


def inputs_of(options: LoopOptions) -> dict[str, Any]:
    """What the figures depend on."""
    names = ("look", "seed", "realtime", "sight", "driver")
    inputs: dict[str, Any] = {name: getattr(options, name) for name in names}
    inputs |= {name: options.place(name) for name in ("start", "goal")}
    inputs |= {"model": options.policy, "map": options.road}
    return dict(json.loads(json.dumps(inputs, default=str)))
