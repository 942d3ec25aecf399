"""``make demo``: train, export, evaluate and drive through virtual hardware, before your eyes."""

import shutil
import subprocess
import sys
import time
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from robot.errors import ConfigError, expect_between
from robot.inference.policy import SHIPPED_MODELS
from robot.output import expect_folder, write_json
from robot.typed_config import read_json, read_yaml
from trainer.cli import Command, run

if TYPE_CHECKING:
    from rich.console import Console

FILE = Path(__file__).with_name("demo.yaml")
NAVIGATOR = SHIPPED_MODELS / "nav_dueling.onnx"
main = partial(run, Command("tools.demo:demo_command"), prog="python -m tools.demo")


@dataclass(frozen=True)
class Stage:
    """One command, and the file that says it is done."""

    title: str
    arguments: tuple[str, ...]
    result: Path


def stages(out: Path, seed: int, seconds: float) -> tuple[Stage, ...]:
    """The stages of the demo, writing into ``out``."""
    demo = read_yaml(FILE)
    places = {**demo["told"], "out": out, "seed": seed, "seconds": seconds, "navigator": NAVIGATOR}
    return tuple(
        Stage(
            row["title"].format(**places),
            tuple(word.format(**places) for word in row["command"].split()),
            out / row["result"],
        )
        for row in demo["stages"]
    )


def run_stage(stage: Stage, console: "Console") -> float:
    """Run one stage unless its result is there; wall-clock seconds it took."""
    console.rule(f"[bold]{stage.title}")
    if stage.result.exists():
        console.print(f"already done: {stage.result}")
        return 0.0
    told = " ".join(stage.arguments).removeprefix("trainer ").removeprefix("tools.")
    console.print(f"[dim]duckpilot {told}", soft_wrap=True)
    begin = time.monotonic()
    subprocess.run([sys.executable, "-m", *stage.arguments], check=True)
    return time.monotonic() - begin


def summarise(out: Path, total_s: float) -> dict[str, Any]:
    """The demo's metrics from the files of its stages."""
    told = read_yaml(FILE)["told"]
    learned_on = told["learned_on"]
    names = ("lane/metrics", "lane/evaluation", "loop", "navigation")
    training, evaluation, loop, navigation = (read_json(out / f"{name}.json") for name in names)
    return {
        "schema": 1,
        "inputs": {"map": " ".join(learned_on), "algo": "dueling", "episodes": told["episodes"]},
        **{name: training[name] for name in ("train_seconds", "train_steps")},
        **{name: told[name] for name in ("learned_on", "judged_on")},
        **{name: evaluation[name] for name in ("success_rate", "mean_path_distance_m")},
        "loop_laps": loop["laps"],
        "missions_arrived": round(navigation["success_rate"] * told["missions"]),
        "total_seconds": round(total_s, 1),
    }


def show(metrics: dict[str, Any], out: Path, console: "Console") -> None:
    """A short table, and the page to open."""
    from rich.table import Table

    table = Table(title="duckpilot demo", show_header=False)
    for name, value in [*metrics.items()][2:]:
        told = ", ".join(value) if isinstance(value, list) else value
        shown = f"{told:.4g}" if isinstance(told, float) else str(told)
        table.add_row(name.replace("_", " "), shown)
    console.print(table)
    page = (out / "report" / "report.html").resolve()
    console.print(f"Open {page}", markup=False, soft_wrap=True)


def demo_command(out: Path = Path("runs/demo"), seed: int = 0, seconds: float = 75.0) -> int:
    """Train, export, evaluate and drive through virtual hardware, before your eyes.

    Every stage is a command that a person can run alone; the demo prints each one, then runs it. A
    demo that was killed goes on with the stage it was in.

    Args:
        seed: of everything random.
        seconds: of training.
    """
    from rich.console import Console

    expect_between("seconds", seconds, 1.0, 1e6)
    expect_folder(out)
    console = Console()
    if (last := out / "metrics.json").exists():
        if "loop_laps" not in last.read_text():
            raise ConfigError(f"{out}: expected a new folder, or one of a demo; choose another")
        shutil.rmtree(out)  # the last demo ended: this is a new one
    out.mkdir(parents=True, exist_ok=True)
    try:
        total_s = sum(run_stage(stage, console) for stage in stages(out, seed, seconds))
    except subprocess.CalledProcessError as error:
        console.print(f"[red]demo stopped: {' '.join(error.cmd[1:])} ended with {error.returncode}")
        return 1
    metrics = summarise(out, total_s)
    write_json(out / "metrics.json", metrics)
    show(metrics, out, console)
    return 0 if metrics["loop_laps"] >= read_yaml(FILE)["told"]["laps"] else 1


if __name__ == "__main__":
    sys.exit(main())
