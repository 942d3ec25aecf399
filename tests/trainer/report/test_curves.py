from pathlib import Path

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from tests.trainer.test_run import episode
from trainer.report.curves import draw_panels, mean_over_runs, running_mean
from trainer.run import Episode


def episodes(first: int, count: int) -> list[Episode]:
    return [episode(first + 16 * k) for k in range(count)]


@given(st.lists(st.floats(-1e3, 1e3), max_size=200), st.integers(1, 60))
def test_running_mean_is_the_mean_of_the_last(values: list[float], window: int) -> None:
    means = running_mean(np.array(values), window)
    expected = [np.mean(values[max(0, i + 1 - window) : i + 1]) for i in range(len(values))]
    np.testing.assert_allclose(means, expected, atol=1e-9)


def test_seeds_are_averaged_only_where_all_of_them_trained() -> None:
    steps, means = mean_over_runs([episodes(16, 10), episodes(48, 100)])
    assert (steps[0], steps[-1]) == (48, 160)
    assert means.shape == (2, len(steps))
    assert not np.array_equal(means[0], means[1])
    alike = mean_over_runs([episodes(16, 30)] * 3)[1]
    np.testing.assert_array_equal(alike[0], alike[2])


def test_panels_of_several_seeds_of_one_and_of_none(tmp_path: Path) -> None:
    several = [(episodes(16, 40), []), (episodes(32, 9), []), ([], [])]
    panels = [
        ("several", several),
        ("one", [(episodes(16, 1), [])]),
        ("none", []),
        ("new", [([], [])]),
    ]
    draw_panels(panels, tmp_path / "all.png")
    assert (tmp_path / "all.png").read_bytes().startswith(b"\x89PNG")
