"""``python -m tools.skill_table RUN...``: what runs needed to learn, and how well they then drive.

Two Markdown tables of run folders: steps and seconds to skill beside those of paper A, and what
`evaluate` and `endure` wrote into the folders as ``*.json``, by the metrics of the AI Driving
Olympics. With ``--by-map`` evaluations are given instead, and the table has a row for each map, of
rings one for each lane, and a column for each evaluation.

``--into FILE --block NAME`` puts them between ``<!-- NAME -->`` and ``<!-- /NAME -->``.
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from robot.command_line import OneLineParser, answer
from robot.errors import ConfigError
from robot.output import expect_writable, write_text

SKILLED = 0.99  # share of a greedy evaluation's episodes that succeed


def skill_table(runs: Sequence[Path]) -> str:
    """A row for each run: when it first drove well, and what all of it took.

    Raises:
        ConfigError: a folder without ``config.yaml`` or ``metrics.json``.
    """
    rows = [_skill_row(run) for run in runs]
    head = (
        "run",
        "task",
        "algorithm",
        "seed",
        "steps to skill",
        "wall s",
        "CPU s",
        "paper A's steps",
    )
    return _markdown((*head, "all steps", "wall s", "CPU s"), rows)


def driving_table(runs: Sequence[Path]) -> str:
    """A row for each evaluation that lies in the runs' folders."""
    rows = []
    for run in runs:
        for path in sorted(run.glob("*.json")):
            result = _read(path)
            if path.name != "metrics.json" and "survival_time_s" in result:
                rows.append((run.name, *_driving_row(result)))
    head = "run", "maps", "look", "pose", "zeroed", "succeeded", "at least"
    return _markdown((*head, "from path cm", "survival s", "driven m", "outside s"), rows)


def ring_table(evaluations: Sequence[Path]) -> str:
    """A row for each map, and of rings each lane; a column for each evaluation, and their sums.

    Raises:
        ConfigError: one of them is absent, or says nothing of its maps.
    """
    results = [_read(path) for path in evaluations]
    heads = [f"`{_policy(r)}`, {r['inputs']['look']}" for r in results]
    columns = []
    for path, result in zip(evaluations, results, strict=True):
        if not result.get("by_map"):
            raise ConfigError(f"{path}: expected an evaluation with by_map, got one without")
        columns.append({(row["map"], row["lane"] or ""): row for row in result["by_map"]})
    rows = []
    for name, lane in sorted({key for column in columns for key in column}):
        found = [column.get((name, lane)) for column in columns]
        cells = [f"{c['succeeded']} of {c['episodes']}" if c else "-" for c in found]
        rows.append((name, lane or "-", *cells))
    sums = [
        f"**{round(r['success_rate'] * r['episodes'])} of {r['episodes']}** "
        f"({100 * r['success_rate']:.1f} %)"
        for r in results
    ]
    return _markdown(("map", "lane", *heads), [*rows, ("all", "", *sums)])


def _policy(result: Mapping[str, Any]) -> str:
    """By its run, where the file is that of a run folder."""
    stem = Path(result["inputs"]["model"]).stem
    return stem.replace("model", str(result["run"])) if stem.startswith("model") else stem


def _skill_row(run: Path) -> tuple[str, ...]:
    from sim_pybullet.tasks.spec import find_task
    from trainer.run import RunFolder

    config, metrics = RunFolder(run).load_config(), _read(run / "metrics.json")
    skilled: dict[str, Any] = next(
        (e for e in metrics["evaluations"] if e["success_rate"] >= SKILLED), {}
    )
    first = [_number(skilled.get(key)) for key in ("step", "seconds", "cpu_seconds")]
    whole = [_number(metrics.get(key)) for key in ("train_steps", "train_seconds", "cpu_seconds")]
    row = find_task(config.task).paper.get(config.algorithm)
    paper = row.told if row else "-"
    return (run.name, config.task, config.algorithm, str(config.seed), *first, paper, *whole)


def _driving_row(result: Mapping[str, Any]) -> tuple[str, ...]:
    inputs = result["inputs"]
    succeeded = round(result["success_rate"] * result["episodes"])
    return (
        ", ".join(Path(name).stem for name in inputs["maps"]),
        Path(inputs["look"]).stem,
        inputs["pose_error"] or "of the look",
        inputs["zero"] or "-",
        f"{succeeded} of {result['episodes']}",
        f"{100 * result['success_rate_low']:.1f} %",
        f"{100 * result['mean_path_distance_m']:.1f}",
        f"{result['survival_time_s']:.1f}",
        f"{result['driven_lane_m']:.1f}",
        f"{result['outside_lane_s']:.2f}",
    )


def _number(value: float | None) -> str:
    return "-" if value is None or math.isnan(value) else f"{value:,.0f}"


def _markdown(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def _read(path: Path) -> dict[str, Any]:
    if not path.exists():
        raise ConfigError(f"{path.parent}: expected the folder of a finished run, no {path.name}")
    return dict(json.loads(path.read_text(encoding="utf-8")))


def put(text: str, file: Path, block: str) -> None:
    """Replace what stands between the marks of ``block`` in a file.

    Raises:
        ConfigError: the marks are not there.
    """
    begin, end = f"<!-- {block} -->\n", f"<!-- /{block} -->"
    before, found, rest = file.read_text(encoding="utf-8").partition(begin)
    _, found_end, after = rest.partition(end)
    if not (found and found_end):
        raise ConfigError(f"{file}: expected a line {begin.strip()} and later {end}, found none")
    write_text(file, f"{before}{begin}\n{text}\n{end}{after}")


def main(arguments: Sequence[str] | None = None) -> int:
    """Exit status 0 done, 2 wrong input."""
    parser = OneLineParser(prog="python -m tools.skill_table", description=__doc__)
    parser.add_argument("runs", type=Path, nargs="+", help="run folders; evaluations by --by-map")
    parser.add_argument("--by-map", action="store_true", help="a row for each map and lane instead")
    parser.add_argument("--into", type=Path, help="a Markdown file; else standard output")
    parser.add_argument("--block", default="tables", help="the name in its marks")
    options = parser.parse_args(arguments)

    def work() -> None:
        expect_writable(options.into)
        if options.by_map:
            text = ring_table(options.runs)
        else:
            text = skill_table(options.runs) + "\n" + driving_table(options.runs)
        if options.into is None:
            sys.stdout.write(text)
        else:
            put(text, options.into, options.block)

    return answer("skill_table", work)


if __name__ == "__main__":
    sys.exit(main())
