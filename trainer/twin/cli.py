"""``duckpilot fit``: a twin from recordings."""

from __future__ import annotations

from pathlib import Path

import tyro
from rich.console import Console

from robot.errors import ConfigError


def fit_command(
    recordings: tyro.conf.Positional[tuple[Path, ...]], out: Path = Path("my_look.yaml")
) -> int:
    """Fit a twin of robot, camera and floor to one to three minutes of driving.

    Leaves a look to train in, and a page beside it that shows recorded pictures and the twin's.

    Args:
        recordings: MCAP files of drives on one map, best with overhead poses.
        out: the look, .yaml.
    """
    from trainer.twin.fit import fit_twin, write_twin
    from trainer.twin.page import write_page
    from trainer.twin.recorded import read_recordings

    if not recordings:
        raise ConfigError("fit: expected one recording or more, got none")
    console = Console(soft_wrap=True, highlight=False)
    drives = read_recordings(recordings)
    with console.status("fitting"):
        twin = fit_twin(drives)
    write_twin(twin, out)
    page = out.with_suffix(".html")
    write_page(twin, drives[0], page)
    for name, value in twin.values.items():
        if not isinstance(value, list):
            console.print(f"{name:24} {value:9.4g} ± {2.0 * twin.sd[name]:.2g}", markup=False)
    for line in twin.unseen:
        console.print(line, markup=False)
    console.print(f"{out}; {page}", markup=False)
    return 0
