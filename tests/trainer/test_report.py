from pathlib import Path

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from tests.trainer.test_run import episode
from trainer.config import preset
from trainer.report import draw_curves, running_mean
from trainer.run import EpisodeLog, RunFolder


@given(st.lists(st.floats(-1e3, 1e3), max_size=200), st.integers(1, 60))
def test_running_mean_is_the_mean_of_the_last(values: list[float], window: int) -> None:
    means = running_mean(np.array(values), window)
    expected = [np.mean(values[max(0, i + 1 - window) : i + 1]) for i in range(len(values))]
    np.testing.assert_allclose(means, expected, atol=1e-9)


def test_curves_of_several_runs_and_of_an_empty_one(tmp_path: Path) -> None:
    runs = []
    for number, algorithm in enumerate(("ddqn", "ppo", "a2c")):
        folder = RunFolder(tmp_path / algorithm)
        folder.create(preset("lane", algorithm, "debug"))
        log = EpisodeLog(folder)
        for step in range(16, 16 * number * 40, 16):
            log.add(episode(step))
        log.close()
        runs.append((folder, folder.load_config()))
    draw_curves(runs, tmp_path / "all.png")
    assert (tmp_path / "all.png").read_bytes().startswith(b"\x89PNG")
