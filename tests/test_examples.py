"""Each example runs in seconds, says something, and leaves the picture that it promises."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import cv2
import pytest

from trainer.processes import ONE_THREAD

ROOT = Path(__file__).parents[1]
EXAMPLES = sorted((ROOT / "examples").glob("[0-9]*.py"))
LEAST = {  # of what an example does in full in some ten seconds
    "02_train_ppo.py": ["1024"],
    "03_cleanrl_loop.py": ["12"],
    "09_drive_in_the_loop.py": ["0.1"],
}
LONGEST_LINES = 60
CPU_SECONDS = 20.0  # wall-clock seconds say as much about the other programs of a computer


def cpu_seconds() -> float:
    """Of all child processes that have ended."""
    times = os.times()
    return times.children_user + times.children_system


def test_there_are_a_dozen_numbered_without_a_gap() -> None:
    numbers = [int(path.name[:2]) for path in EXAMPLES]
    assert len(numbers) >= 12
    assert numbers == list(range(1, len(numbers) + 1))


def test_the_readme_tells_an_example_that_runs() -> None:
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    told = readme.split("```python\n")[1].split("```")[0]
    exec(compile(told, "README.md", "exec"), {})


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.stem)
def test_it_runs_in_seconds_and_leaves_a_picture(example: Path, tmp_path: Path) -> None:
    assert len(example.read_text(encoding="utf-8").splitlines()) <= LONGEST_LINES
    began = cpu_seconds()
    done = subprocess.run(
        [sys.executable, str(example), str(tmp_path), *LEAST.get(example.name, [])],
        env={**os.environ, **ONE_THREAD, "PYTHONPATH": str(ROOT), "MPLBACKEND": "Agg"},
        capture_output=True,
        text=True,
        timeout=580,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip()
    picture = cv2.imread(str(tmp_path / f"{example.stem}.png"))
    assert picture is not None
    assert picture.std() > 5.0  # it shows something
    assert cpu_seconds() - began <= CPU_SECONDS
