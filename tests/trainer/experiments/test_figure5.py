"""Figure 5 of paper B: what its drivers differ in, and what is made of their records."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sim_pybullet.randomise import looks_of
from tests import thorough
from trainer.cli import main
from trainer.config import RunConfig
from trainer.experiments.figure5 import (
    VARIANTS,
    Curve,
    Figure5Options,
    as_table,
    on_common_steps,
    trainings,
)
from trainer.report.curves import half_interval
from trainer.training.train import judged

OPTIONS = Figure5Options(seeds=2)
TRANSLATOR = Path("translator.onnx")


def configs() -> dict[str, RunConfig]:
    """Of the first seed, by driver; the translator does not exist."""
    jobs = trainings(Path("out"), OPTIONS, TRANSLATOR)
    return {job.out.name.removesuffix("_0"): job.options.config() for job in jobs[: len(VARIANTS)]}


def test_drivers_differ_in_what_is_compared_only() -> None:
    found = configs()
    assert set(found) == set(VARIANTS)
    alike = {repr(replace(c, maps=(), look="nominal", translate=None)) for c in found.values()}
    assert len(alike) == 1
    assert [name for name, c in found.items() if c.translate] == ["translated"]
    assert [name for name, c in found.items() if len(looks_of(c.look)) > 1] == ["dr"]
    assert len(looks_of(found["dr"].look)) == 10
    assert len(trainings(Path("out"), OPTIONS, TRANSLATOR)) == 2 * len(VARIANTS)


def test_only_the_oracle_learns_where_all_are_judged() -> None:
    for name, config in configs().items():
        test = judged(config)
        assert (test.maps, test.look) == ((OPTIONS.test_map,), OPTIONS.test_look)
        assert test.translate is None
        assert (config.maps == test.maps) == (config.look == test.look) == (name == "oracle")
        assert Path(OPTIONS.test_look).name not in [f.stem for f in looks_of(config.look)] or (
            name == "oracle"
        )


def curve(variant: str, *learned: float) -> Curve:
    steps = tuple((10 + k, 20, 30 + k) for k in range(len(learned)))
    rewards = tuple((0.0, reward / 2.0, reward) for reward in learned)
    return Curve(variant, steps, rewards, learned, tuple(0.5 for _ in learned))


def test_every_driver_has_a_row() -> None:
    assert as_table(OPTIONS, [curve(name, 9, 11) for name in VARIANTS]).row_count == 4


def test_the_interval_is_students() -> None:
    # of 1, 2, 3: standard deviation 1, two degrees of freedom
    assert half_interval(np.array([1.0, 2.0, 3.0])) == pytest.approx(
        4.3027 / np.sqrt(3.0), rel=1e-4
    )
    assert np.isnan(half_interval(np.array([1.0])))


def test_seeds_are_compared_at_steps_that_all_have_reached() -> None:
    grid, rewards = on_common_steps(curve("dr", 6.0, 8.0))
    assert (grid[0], grid[-1]) == (11, 30)
    assert rewards[0, -1] == 6.0
    assert rewards[1, -1] < 8.0


@thorough.only
def test_the_command_compares_and_does_nothing_twice(tmp_path: Path) -> None:
    out = tmp_path / "f"
    command = [
        "experiment",
        "paper-b-transfer",
        "--out",
        str(out),
        "--algo",
        "ppo",
        "--preset",
        "debug",
    ]
    command += ["--map", "karting", "--test-map", "karting", "--frames", "8", "--workers", "1"]
    command += ["--translator-steps", "2", "--seeds", "1", "--steps", "256"]
    assert main(command) == 0
    found = json.loads((out / "figure5.json").read_text())
    assert [c["variant"] for c in found["curves"]] == list(VARIANTS)
    assert all(c["steps"][0][-1] == 256 for c in found["curves"])
    assert (out / "figure5.png").exists()
    before = {file: file.stat().st_mtime_ns for file in out.glob("*/*.*")}
    assert main(command) == 0
    assert before == {file: file.stat().st_mtime_ns for file in out.glob("*/*.*")}
