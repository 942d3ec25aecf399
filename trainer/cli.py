"""The command line. Exit status: 0 done, 2 wrong input, 1 anything else."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console
from rich.table import Table

from robot.errors import DuckpilotError
from trainer.config import ALGORITHMS, preset
from trainer.run import RunFolder

app = tyro.extras.SubcommandApp()


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
    """Parameters and multiply-accumulates of one decision, for every algorithm.

    Args:
        preset_name: paper, fast or debug.
    """
    from trainer.summary import summarise

    table = Table("algorithm", "picture", "parameters", "driving", "MMAC", title=preset_name)
    for name in ALGORITHMS:
        row = summarise(preset("lane", name, preset_name))
        shape = "x".join(map(str, row.image))
        table.add_row(
            name, shape, f"{row.parameters:,}", f"{row.driving:,}", f"{row.macs / 1e6:.2f}"
        )
    Console().print(table)
    return 0


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; the exit status."""
    try:
        return int(app.cli(args=arguments, prog="python -m trainer") or 0)
    except DuckpilotError as error:
        Console(stderr=True, soft_wrap=True).print(f"trainer: {error}", markup=False)
        return 2
