"""``make bench``: the tables of figures, and ``runs/bench.json``."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

from robot.cli.bench import measure as measure_robot
from robot.command_line import OneLineParser, answer
from robot.contract import ACTION_WHEELS, ImageSpec
from robot.inference.policy import SHIPPED_MODELS, OnnxPolicy, time_decisions
from robot.navigation.road_map import load_map
from robot.output import expect_writable, write_json

ROBOTS = 64
SMALL = ImageSpec(80, 60, crop_top_px=20)
UPDATE_CHANNELS = 10  # of the HAT, 3 to 12: the coils of both motors and the PWM between


def seconds_per_call(*works: Callable[[], object], least_s: float = 1.0) -> tuple[float, ...]:
    """Median wall-clock seconds of each call, over at least ``least_s`` [s] and five calls.

    Measured A B A B, so that a busy machine slows all alike.
    """
    for work in works:
        work()
    times: list[list[float]] = []
    while len(times) < 5 or sum(map(sum, times)) < least_s:
        moments = [time.perf_counter()]
        for work in works:
            work()
            moments.append(time.perf_counter())
        times.append(np.diff(moments).tolist())
    return tuple(np.median(np.array(times), axis=0).tolist())


def camera_figures() -> dict[str, float]:
    """Both cameras, 160x120 fisheye, the same scene and poses, measured in turn."""

    from sim_pybullet.look import NOMINAL
    from sim_pybullet.rendering.ray_camera import RayCamera
    from sim_pybullet.scenery.objects import build_scene, lane_poses
    from tests.sim_pybullet.pybullet_camera import PyBulletCamera

    rng, road_map, rig = np.random.default_rng(0), load_map("town"), NOMINAL.rig()
    scene = build_scene(road_map, NOMINAL, rng)
    poses = lane_poses(road_map, ROBOTS, rng)
    ray, small = RayCamera(ImageSpec(), ROBOTS), RayCamera(SMALL, ROBOTS)
    for camera in (ray, small):
        for i in range(ROBOTS):
            camera.set_robot(i, scene, rig)
    reference = PyBulletCamera(scene, rig, ImageSpec())
    ray_s, reference_s = seconds_per_call(
        lambda: ray.render(poses), lambda: reference.render(poses[:4]), least_s=4.0
    )
    reference.close()
    (small_s,) = seconds_per_call(lambda: small.render(poses))
    ray_fps, pybullet_fps = ROBOTS / ray_s, 4 / reference_s
    return {
        "ray_fps": ray_fps,
        "pybullet_fps": pybullet_fps,
        "ratio": ray_fps / pybullet_fps,
        "ray_80x40_fps": ROBOTS / small_s,
    }


def step_figures() -> dict[str, float]:
    """Steps of a batch per second: with whole pictures, and with small ones."""
    from sim_pybullet.batch import BatchWorld
    from sim_pybullet.look import NOMINAL
    from sim_pybullet.tasks.lane_keeping import LaneKeeping

    rng, actions = np.random.default_rng(0), len(ACTION_WHEELS)

    def rate(image: ImageSpec) -> float:
        world = BatchWorld(LaneKeeping([load_map("loop")], ROBOTS), [NOMINAL], image)
        world.reset()
        step = lambda: world.step(rng.integers(actions, size=ROBOTS))  # noqa: E731
        (step_s,) = seconds_per_call(step, least_s=3.0)
        world.close()
        return ROBOTS / step_s

    return {
        "robot_steps_per_s": rate(ImageSpec()),
        "robot_steps_per_s_80x40": rate(SMALL),
    }


def gpu_figures() -> dict[str, float]:
    """Pictures of 80x40 a second, drawn and sensed on a GPU for many robots; none without one."""
    import torch

    if not torch.cuda.is_available():
        return {}
    from sim_pybullet.randomise import load_look_sampler
    from sim_pybullet.rendering.torch_camera import TorchCamera
    from sim_pybullet.scenery.objects import build_scene, lane_poses
    from sim_pybullet.sensing.torch_sensor import TorchSensors

    rng, road_map = np.random.default_rng(0), load_map("town")
    count, sample, robots = 2048, load_look_sampler("randomised"), np.arange(2048)
    camera, poses = TorchCamera(SMALL, count), lane_poses(road_map, count, rng)
    sensors = TorchSensors(count, camera.shape, SMALL.crop_top_px)
    looks = [sample(rng) for _ in range(count)]
    scenes = [build_scene(road_map, look, rng) for look in looks[:32]]
    for i, look in enumerate(looks):
        camera.set_robot(i, scenes[i % len(scenes)], look.rig())
        sensors.put(i, look.sensor)

    def drawn() -> None:
        camera.render(poses)
        torch.cuda.synchronize()

    def sensed() -> None:
        sensors.take(camera.render(poses), robots, rng)
        torch.cuda.synchronize()

    drawn_s, sensed_s = seconds_per_call(drawn, sensed, least_s=3.0)
    return {"drawn_fps": count / drawn_s, "sensed_fps": count / sensed_s}


def training_figures() -> dict[str, dict[str, float]]:
    """Lane keeping by Dueling and navigation by PPO: decisions a second of processor time."""
    from tests.tools.training_speed import CASES, in_checkout

    seen = [case for case in CASES if not case.endswith("_seen")]
    return {case: asdict(in_checkout(case, Path(__file__).parents[1])) for case in seen}


def inference_figures(model: Path) -> dict[str, dict[str, float]]:
    """p50 and p99 of one decision on one thread, for the FP32 file and the INT8 file beside it."""
    files = {"fp32": model, "int8": model.with_name(f"{model.stem}_int8.onnx")}
    there = {kind: OnnxPolicy(path) for kind, path in files.items() if path.exists()}
    return {kind: asdict(time_decisions(policy)) for kind, policy in there.items()}


def hat_figures() -> dict[str, float]:
    """One atomic update of both motors: on the emulator, and on the wire."""
    from robot.computer.clock import MonotonicClock
    from robot.hat.bus import Pca9685, bus_time_s
    from robot.hat.config import HatConfig
    from sim_pybullet.virtual.hat import VirtualHat
    from sim_pybullet.virtual.i2c import VirtualI2cBus

    bus, clock = VirtualI2cBus(), MonotonicClock()
    VirtualHat(bus, clock)
    chip = Pca9685.probe(bus, HatConfig().addresses, clock)
    chip.initialise()
    (host_s,) = seconds_per_call(lambda: chip.set_channels(3, [0.0] * UPDATE_CHANNELS))
    count = 1 + 4 * UPDATE_CHANNELS
    return {
        "update_ms": 1e3 * bus_time_s(count, 100_000),
        "update_400khz_ms": 1e3 * bus_time_s(count, 400_000),
        "emulator_host_ms": 1e3 * host_s,
    }


def measure(model: Path) -> dict[str, Any]:
    """Every part, one after the other."""
    parts: dict[str, Callable[[], Any]] = {
        "camera": camera_figures,
        "gpu": gpu_figures,
        "step": step_figures,
        "training": training_figures,
        "inference": lambda: inference_figures(model),
        "robot": lambda: measure_robot(model, 5.0)["robot"],
        "hat": hat_figures,
    }
    inputs = {"model": str(model), "robots": ROBOTS, "cpus": os.cpu_count()}
    figures: dict[str, Any] = {"schema": 1, "inputs": inputs}
    for name, part in track(parts.items(), description="bench"):
        figures[name] = part()
    return figures


def show(figures: dict[str, Any], console: Console) -> None:
    """One table of everything that was measured."""
    table = Table("figure", "value", title="duckpilot bench")

    def add(name: str, value: Any) -> None:
        if isinstance(value, dict):
            for inner in value:
                add(f"{name}.{inner}", value[inner])
        else:
            table.add_row(name, f"{value:,.3g}" if value < 100 else f"{value:,.0f}")

    for part in [*figures][2:]:
        add(part, figures[part])
    console.print(table)


def main(arguments: list[str] | None = None) -> int:
    """Measure, write and show."""
    parser = OneLineParser(prog="python -m tests.bench", description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("runs/bench.json"))
    parser.add_argument("--model", type=Path, default=SHIPPED_MODELS / "lane_dueling.onnx")
    options = parser.parse_args(arguments)

    def work() -> None:
        expect_writable(options.out, inputs=[options.model])
        OnnxPolicy(options.model)  # refused now rather than after half of the measurements
        figures = measure(options.model)
        write_json(options.out, figures)
        show(figures, Console())

    return answer("bench", work)


if __name__ == "__main__":
    sys.exit(main())
