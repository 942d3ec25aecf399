"""The command line. Exit status: 0 done, 2 wrong input, 1 anything else."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

import tyro
from rich.console import Console
from rich.progress import MofNCompleteColumn, Progress
from rich.table import Table

from robot.errors import ConfigError, DuckpilotError
from robot.policy import OnnxPolicy
from robot.road_map import load_map
from robot.translator import TranslatingPolicy, open_translator
from sim_pybullet.randomise import load_look_sampler
from trainer.config import ALGORITHMS, TASKS, TESTS, RunConfig, choose, preset
from trainer.run import RunFolder, write_json

EXPORT_ROBOTS = 32

app = tyro.extras.SubcommandApp()


@app.command(name="train")
def train_command(
    out: Path,
    task: str = "lane",
    algo: str = "dueling",
    preset_name: Annotated[str, tyro.conf.arg(name="preset")] = "fast",
    map_names: Annotated[tuple[str, ...], tyro.conf.arg(name="map")] = (),
    steps: int | None = None,
    seconds: float | None = None,
    seed: int = 0,
    look: str = "nominal",
    pose_error: str | None = None,
    translate: Path | None = None,
    full: bool = False,
    resume: bool = False,
) -> int:
    """Train a policy; leaves a run folder with model.onnx, curve.png and metrics.json.

    Args:
        out: the run's folder; must not hold a run yet, unless --resume.
        task: lane or navigation.
        algo: ddqn, dueling, a2c, ppo or dagger.
        preset_name: paper, fast or debug.
        map_names: map files, or names of shipped maps; else loop for lane, arena for navigation.
        steps: decisions of all robots together; else the preset's.
        seconds: stop after so much wall-clock time.
        seed: of everything random.
        look: a YAML file with a look or a distribution of looks, or the name of a shipped one.
        pose_error: none or arena, in place of the look's own.
        translate: an ONNX translator that every picture passes through.
        full: use all the steps, even when the task has been learned.
        resume: go on with the run in --out, if there is one, with its own configuration.
    """
    folder = RunFolder(out)
    if not resume:
        folder.refuse_run()
    if resume and folder.config.exists():
        config = _extended(folder.load_config(), steps, seconds)
    else:
        config = _extended(preset(task, algo, preset_name), steps, seconds)
        maps = map_names or config.maps
        config = replace(config, maps=maps, seed=seed, look=look, pose_error=pose_error)
        if translate is not None:
            config = replace(config, translate=str(translate))
        if full:
            endless = replace(config.evaluation, stop_after_perfect=0)
            config = replace(config, evaluation=endless)
    from trainer.envs import make_env
    from trainer.train import train

    console = Console()
    metrics = train(config, folder, make_env, console)
    console.print(
        f"{out}: {metrics.train_steps} steps in {metrics.train_seconds:.1f} s, success "
        f"{metrics.success_rate:.0%}, stopped by {metrics.stopped_by}"
    )
    return 1 if metrics.stopped_by == "interrupted" else 0


@app.command(name="evaluate")
def evaluate_command(
    model: Path,
    json: Path | None = None,
    task: str | None = None,
    map_names: Annotated[tuple[str, ...], tyro.conf.arg(name="map")] = (),
    look: str = "nominal",
    pose_error: str | None = None,
    translate: Path | None = None,
    zero: Literal["image", "path"] | None = None,
    episodes: int = 100,
    seed: int = 1000,
) -> int:
    """Drive an exported policy greedily through whole frames, and count successes.

    Args:
        model: a policy, .onnx.
        json: write the figures there.
        task: lane, navigation or manoeuvres; else what the policy was trained for.
        map_names: map files, or names of shipped maps; else loop for lane, else arena.
        look: a YAML file with a look or a distribution of looks, or the name of a shipped one.
        pose_error: none or arena, in place of the look's own.
        translate: an ONNX translator between the preprocessed picture and the policy.
        zero: what the policy gets zeros for, to see what it is worth.
        episodes: how many.
        seed: of the first episode; the next ones have the next seeds.
    """
    from trainer.evaluate import DrivingPolicy, Inputs, evaluate, summarise

    if episodes < 1:
        raise ConfigError(f"episodes: expected 1 or more, got {episodes}")
    policy: DrivingPolicy = OnnxPolicy(model)
    if translate is not None:
        policy = TranslatingPolicy(policy, open_translator(translate, policy.contract.image))
    task = task or policy.contract.task
    map_names = map_names or (choose("task", task, TESTS),)
    maps = [load_map(name) for name in map_names]
    looks, seeds = load_look_sampler(look, pose_error), range(seed, seed + episodes)
    with Progress(*Progress.get_default_columns(), MofNCompleteColumn()) as bar:
        row = bar.add_task(f"{task} {model.name}", total=episodes)
        drives = evaluate(policy, task, maps, looks, seeds, lambda _: bar.advance(row), zero)
    through = str(translate) if translate is not None else None
    inputs = Inputs(str(model), task, map_names, look, pose_error, zero, episodes, seed, through)
    result = summarise(inputs, policy, drives)
    if json is not None:
        write_json(json, result)
    Console(soft_wrap=True).print(
        f"{model}: success {result.success_rate:.1%} of {episodes} (at least "
        f"{result.success_rate_low:.1%} with 95 % confidence), "
        f"{100 * result.mean_path_distance_m:.1f} cm from the path"
    )
    return 0


@app.command(name="endure")
def endure_command(
    model: Path,
    json: Path | None = None,
    map_names: Annotated[tuple[str, ...], tyro.conf.arg(name="map")] = (TASKS["lane"],),
    look: str = "nominal",
    hours: float = 1.0,
    robots: int = 4,
    seed: int = 1000,
) -> int:
    """Let a policy keep its lane for hours of simulated time, and see who leaves it.

    Args:
        model: a policy for lane keeping, .onnx.
        json: write the figures there.
        map_names: rings of road, files or names of shipped maps.
        look: a YAML file with a look or a distribution of looks, or the name of a shipped one.
        hours: of simulated time.
        robots: each at a place and in a look of its own.
        seed: of everything random.
    """
    from trainer.endurance import endure

    policy, maps = OnnxPolicy(model), [load_map(name) for name in map_names]
    with Progress() as bar:
        row = bar.add_task(f"{hours:g} h {model.name}", total=hours * 36_000)
        looks = load_look_sampler(look)
        result = endure(policy, maps, looks, hours, robots, seed, lambda: bar.advance(row))
    if json is not None:
        write_json(json, result)
    Console(soft_wrap=True).print(
        f"{model}: {result.stayed} of {robots} stayed in their lane for {hours:g} h, "
        f"{result.driven_lane_m:.0f} m each, {100 * result.mean_path_distance_m:.1f} cm from its "
        f"middle, {100 * result.largest_path_distance_m:.1f} cm at most"
    )
    return 0


@app.command(name="export")
def export_command(run: tyro.conf.Positional[Path]) -> int:
    """Write model.onnx and model_int8.onnx of a run, checked against torch on 1,000 frames.

    Args:
        run: its folder.
    """
    from trainer.envs import make_env
    from trainer.export import export_run

    folder = RunFolder(run)
    config = folder.load_config()
    env = make_env(config, EXPORT_ROBOTS, config.seed)
    exported = export_run(folder, config, env)
    env.close()
    Console(soft_wrap=True).print(
        f"{folder.onnx}: differs from torch by at most {exported.largest_difference:.1e} over "
        f"{exported.frames} frames; INT8 chooses alike on {exported.int8_same_choice:.1%}"
    )
    return 0


@app.command(name="report")
def report_command(runs: tyro.conf.Positional[tuple[Path, ...]], out: Path | None = None) -> int:
    """Draw the learning curves of runs again, and all of them side by side.

    Args:
        runs: run folders.
        out: the picture of all runs together; else none.
    """
    from trainer.report import draw_curve, draw_curves

    folders = [(RunFolder(run), RunFolder(run).load_config()) for run in runs]
    for folder, config in folders:
        draw_curve(folder, config)
    if out is not None:
        draw_curves(folders, out)
    return 0


@app.command(name="summary")
def summary_command(preset_name: Annotated[str, tyro.conf.arg(name="preset")] = "fast") -> int:
    """Parameters and multiply-accumulates of one decision, for every task and algorithm.

    Args:
        preset_name: paper, fast or debug.
    """
    from trainer.summary import summarise

    columns = ("task", "algorithm", "picture", "parameters", "driving", "MMAC")
    table = Table(*columns, title=preset_name)
    for task, name in itertools.product(TASKS, ALGORITHMS):
        row = summarise(preset(task, name, preset_name))
        figures = f"{row.parameters:,}", f"{row.driving:,}", f"{row.macs / 1e6:.2f}"
        table.add_row(task, name, "x".join(map(str, row.image)), *figures)
    Console().print(table)
    return 0


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; the exit status."""
    try:
        return int(app.cli(args=arguments, prog="python -m trainer") or 0)
    except DuckpilotError as error:
        Console(stderr=True, soft_wrap=True).print(f"trainer: {error}", markup=False)
        return 2


def _extended(config: RunConfig, steps: int | None, seconds: float | None) -> RunConfig:
    return replace(
        config,
        steps=config.steps if steps is None else steps,
        seconds=config.seconds if seconds is None else seconds,
    )
