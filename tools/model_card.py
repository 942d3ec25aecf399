"""``python -m tools.model_card RUN NAME``: ship a run's policy in ``robot/models`` with its card.

Copies ``model.onnx`` and ``model_int8.onnx`` of a finished run as ``NAME.onnx`` and
``NAME_int8.onnx`` and writes ``NAME.md``: what it was trained for, the command, and every
evaluation that lies in the run's folder (``evaluate --json RUN/….json``).
"""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from robot.command_line import OneLineParser, answer
from robot.errors import ConfigError
from robot.inference.policy_file import SHIPPED_MODELS
from robot.navigation.road_map import shipped_maps
from robot.output import expect_writable
from sim_pybullet.tasks.spec import find_task
from trainer.algorithms import find_algorithm
from trainer.config import RunConfig
from trainer.presets import preset
from trainer.run import RunFolder, atomically

_WAYS = {"both": "; rings in both directions", "inner": "; rings clockwise"}
_ZEROED = {None: "", "image": ", picture empty (`--zero image`)", "path": ", path empty"}


def train_command(config: RunConfig, out: str) -> str:
    """The command that begins this run again."""
    options = [f"--task {config.task}", f"--algo {config.algorithm}", f"--preset {config.preset}"]
    options += [f"--map {' '.join(_named(config.maps))}", f"--look {config.look}"]
    if config.without:
        options.append(f"--without {' '.join(config.without)}")
    for name in ("pose_error", "translate"):
        value = getattr(config, name)
        options += [f"--{name.replace('_', '-')} {value}"] if value else []
    options += [f"--lane {config.lane}"] if config.lane != "outer" else []
    chosen_on = config.evaluation
    options += [f"--judge-map {' '.join(_named(chosen_on.maps))}"] if chosen_on.maps else []
    options += [f"--judge-look {chosen_on.look}"] if chosen_on.look else []
    options += [f"--style {config.style}"] if config.style != "race" else []
    usual = preset(config.task, config.algorithm, config.preset)
    full = bool(usual.evaluation.stop_after_perfect) and not config.evaluation.stop_after_perfect
    if chosen_on.every_share != usual.evaluation.every_share:
        options.append(f"--judgings {round(1.0 / chosen_on.every_share)}")
    for name in ("start_spread", "true_path", "rate_left"):
        if getattr(config, name) != getattr(usual, name):
            options.append(f"--{name.replace('_', '-')} {getattr(config, name):g}")
    options += [f"--steps {config.steps}", *["--full"] * full]
    options += [f"--seed {config.seed}", f"--out {out}"]
    return f"python -m trainer train {' '.join(options)}"


def card(run: Path, name: str) -> str:
    """The card, Markdown.

    Raises:
        ConfigError: the run has not ended.
    """
    config, metrics = RunFolder(run).load_config(), _read(run / "metrics.json")
    judged = [_read(path) for path in sorted(run.glob("*.json")) if path.stem != "metrics"]
    rows = [_row(result, name) for result in judged if "survival_time_s" in result]
    seconds = f"{metrics['train_seconds']:.0f} s by the clock, {metrics['cpu_seconds']:.0f} of CPU"
    height, width, _ = config.image.shape
    picture = f"{width}×{height}"
    lines = [
        f"# {name}",
        "",
        find_task(config.task).purpose,
        "",
        f"{find_algorithm(config.algorithm).title}, preset `{config.preset}` ({picture} pictures), "
        f"trained for {metrics['train_steps']:,} steps in {seconds}, evaluations included.",
        f"Learned on {_listed(config.maps)}; look `{config.look}`; "
        f"pose error {config.pose_error or 'of the look'}{_WAYS.get(config.lane, '')}. "
        f"Chosen on {_listed(config.evaluation.maps or config.maps)}.",
        "",
        f"    {train_command(config, f'runs/{name}')}",
        "",
        f"`{name}_int8.onnx` is the same, its convolutions and the layer after them quantised."
        + _agreement(run),
        "",
        "Judged by `python -m trainer evaluate`, one greedy episode for each seed:",
        "",
        "| file | maps | look, pose error | succeeded | least of a map | from the path | seed |",
        "| --- | --- | --- | --- | --- | --- | --- |",
        *rows,
        "",
    ]
    return "\n".join(lines)


def ship(run: Path, name: str, models: Path) -> None:
    """Copy the policies of a run to ``models`` and write their card.

    Raises:
        ConfigError: the run has not ended or was not exported.
    """
    expect_writable(*(models / f"{name}{end}" for end in (".onnx", "_int8.onnx", ".md")))
    text = card(run, name)
    for source, target in (
        ("model.onnx", f"{name}.onnx"),
        ("model_int8.onnx", f"{name}_int8.onnx"),
    ):
        if not (run / source).exists():
            raise ConfigError(
                f"{run}: expected {source}, found none; python -m trainer export {run} writes it"
            )
        with atomically(models / target) as temporary:
            temporary.write_bytes((run / source).read_bytes())
    with atomically(models / f"{name}.md") as temporary:
        temporary.write_text(text, encoding="utf-8")


def _agreement(run: Path) -> str:
    path = RunFolder(run).exported
    if not path.exists():
        return ""
    exported = _read(path)
    alike, frames = exported["int8_same_choice"], exported["frames"]
    return f"\nIt chooses alike on {alike:.1%} of {frames:,} frames that it was not calibrated on."


def _row(result: Mapping[str, Any], name: str) -> str:
    asked = result["inputs"]
    file = f"{name}_int8.onnx" if Path(asked["model"]).stem.endswith("int8") else f"{name}.onnx"
    succeeded = round(result["success_rate"] * result["episodes"])
    cells = (
        f"`{file}`{_ZEROED[asked['zero']]}",
        ", ".join(_stems(asked["maps"])),
        f"{Path(asked['look']).stem}, {asked['pose_error'] or 'of the look'}",
        f"{succeeded} of {result['episodes']} (95 %: at least "
        f"{100 * result['success_rate_low']:.1f} %)",
        _least(result.get("by_map", ())),
        f"{100 * result['mean_path_distance_m']:.1f} cm",
        str(asked["seed"]),
    )
    return f"| {' | '.join(cells)} |"


def _least(by_map: Sequence[Mapping[str, Any]]) -> str:
    """The map, and of a ring its lane, on which the fewest succeeded."""
    if len(by_map) < 2:
        return "-"
    row = min(by_map, key=lambda each: each["succeeded"] / each["episodes"])
    where = f"{row['map']} {row['lane']}" if row["lane"] else row["map"]
    return f"{where} {row['succeeded']} of {row['episodes']}"


def _stems(names: Sequence[str]) -> list[str]:
    return [Path(name).stem for name in names]


def _named(names: Sequence[str]) -> list[str]:
    """As they can be asked for again: shipped maps by their names, files without their folders."""
    return [name if name in shipped_maps() else Path(name).stem for name in names]


def _listed(names: Sequence[str]) -> str:
    return ", ".join(f"`{name}`" for name in _named(names))


def _read(path: Path) -> dict[str, Any]:
    if not path.exists():
        raise ConfigError(f"{path.parent}: expected the folder of a finished run, no {path.name}")
    return dict(json.loads(path.read_text(encoding="utf-8")))


def main(arguments: Sequence[str] | None = None) -> int:
    """Exit status 0 done, 2 wrong input."""
    parser = OneLineParser(prog="python -m tools.model_card", description=__doc__)
    parser.add_argument("run", type=Path, help="the folder of a finished run")
    parser.add_argument("name", help="of the policy, such as nav_ppo")
    parser.add_argument("--models", type=Path, default=SHIPPED_MODELS)
    options = parser.parse_args(arguments)
    return answer("model_card", lambda: ship(options.run, options.name, options.models))


if __name__ == "__main__":
    sys.exit(main())
