from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tests.trainer.test_run import episode
from trainer.report.curves import _draw_success, draw_panels, running_mean
from trainer.run import Episode
from trainer.training.checkpoint import Evaluated


def episodes(first: int, count: int) -> list[Episode]:
    return [episode(first + 16 * k) for k in range(count)]


@given(st.lists(st.floats(-1e3, 1e3), max_size=200), st.integers(1, 60))
def test_running_mean_is_the_mean_of_the_last(values: list[float], window: int) -> None:
    means = running_mean(np.array(values), window)
    expected = [np.mean(values[max(0, i + 1 - window) : i + 1]) for i in range(len(values))]
    np.testing.assert_allclose(means, expected, atol=1e-9)


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


def lines(records: list, draw: Callable[[Axes, list], None]) -> Axes:
    axis = Figure().subplots()
    draw(axis, records)
    return axis


def test_the_first_curve_says_learned_where_an_evaluation_had_no_failure() -> None:
    evaluations = [Evaluated(100 * k, 1.0, share, 5.0, 9.0) for k, share in ((1, 0.5), (2, 1.0))]
    axis = lines([(episodes(16, 40), evaluations)], _draw_success)
    told = axis.get_legend_handles_labels()[1]
    assert "learned: 200 steps" in told
    before = lines([(episodes(16, 40), evaluations[:1])], _draw_success)
    assert not any("learned" in label for label in before.get_legend_handles_labels()[1])
    dots = {tuple(line.get_ydata()) for line in axis.lines}
    assert {(50.0,), (100.0,)} <= dots


def test_distances_are_drawn_where_evaluations_have_them(tmp_path: Path) -> None:
    def width(distance_m: float | None) -> int:
        evaluations = [Evaluated(100, 1.0, 1.0, 5.0, 9.0, mean_distance_m=distance_m)]
        draw_panels([("run", [(episodes(16, 9), evaluations)])], tmp_path / "a.png")
        return cv2.imread(str(tmp_path / "a.png")).shape[1]

    assert width(0.02) == pytest.approx(1.5 * width(None), rel=0.02)
