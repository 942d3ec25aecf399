"""The commands of recorded drives; they import nothing heavy."""

from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from robot.errors import ConfigError
from robot.output import expect_writable, write_json

Recordings = Annotated[Positional[tuple[Path, ...]], arg(help="recordings, or folders of them.")]
NewFolder = Annotated[Path, arg(help="a new folder.")]


def list_command(recordings: Recordings) -> int:
    """What is in recordings: who drove how long, take-overs, marks."""
    from tools.data.drives import drives_in, table, tell

    print(table([tell(path) for path in drives_in(recordings)]))
    return 0


def plot_command(recordings: Recordings, out: Path) -> int:
    """Steering and speed over time, as a picture."""
    from tools.data.drives import drives_in, plot

    found = drives_in(recordings)
    expect_writable(out, inputs=found)
    plot(found, out)
    return 0


def split_command(recordings: Recordings, out: Path, held_out: float = 0.2, seed: int = 0) -> int:
    """Whole drives to learn from, and others to judge by.

    Args:
        out: JSON: learn and held_out.
        held_out: share to judge by.
    """
    from tools.data.drives import divide, drives_in

    found = drives_in(recordings)
    expect_writable(out, inputs=found)
    parts = divide(found, held_out, seed)
    write_json(out, parts)
    print(", ".join(f"{name} {len(paths)} drives" for name, paths in parts.items()))
    return 0


def cut_command(source: Positional[Path], out: Path) -> int:
    """A new recording of what is marked good, less what is marked bad."""
    from robot.recording.reader import cut
    from tools.data.drives import drives_in

    expect_writable(out, inputs=drives_in([source]))
    if out.exists():
        raise ConfigError(f"{out}: expected no recording there yet; choose another --out")
    print(f"{out}: {cut(source, out)} messages")
    return 0


def to_donkeycar_command(recordings: Recordings, out: NewFolder) -> int:
    """Recordings as a Donkeycar tub (version 2)."""
    from tools.data.drives import drives_in, to_tub

    print(f"{out}: {to_tub(drives_in(recordings), out)} records")
    return 0


def to_lerobot_command(
    recordings: Recordings, out: NewFolder, task: str = "drive along the lane"
) -> int:
    """Recordings as a LeRobot dataset (3.0) of a task in words; needs the extra lerobot."""
    from tools.data.drives import drives_in
    from tools.data.lerobot import to_dataset

    print(f"{out}: {to_dataset(drives_in(recordings), out, task)} episodes")
    return 0


def from_donkeycar_command(source: Positional[Path], out: NewFolder) -> int:
    """A Donkeycar tub as recordings."""
    from tools.data.drives import from_tub

    print(f"{out}: {len(from_tub(source, out))} drives")
    return 0


def from_lerobot_command(source: Positional[Path], out: NewFolder) -> int:
    """A LeRobot dataset of two wheels as recordings; needs the extra lerobot."""
    from tools.data.lerobot import from_dataset

    print(f"{out}: {len(from_dataset(source, out))} drives")
    return 0
