"""Tracks are closed, keep their files' lengths, and turn as their segments say."""

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot.errors import ConfigError, MapError
from robot.geometry import wrap_angle
from sim_pybullet.racing.track import (
    SCALE,
    Segment,
    Track,
    centre_line,
    close,
    load_track,
    mirrored,
    shipped_tracks,
)


def arc(radius_m: float, angle_deg: float) -> Segment:
    return Segment(0.0, radius_m, angle_deg)


OVAL: tuple[Segment, ...] = (
    Segment(50.0),
    arc(20.0, 180.0),
    Segment(50.0),
    arc(20.0, 180.0),
)


def test_at_least_four_tracks_ship() -> None:
    assert len(shipped_tracks()) >= 4


@pytest.mark.parametrize("name", shipped_tracks())
def test_shipped_tracks_are_closed_and_nowhere_too_tight(name: str) -> None:
    track = load_track(name)
    assert track.name == name
    assert close(track) == track
    radii = [segment.radius_m for segment in track.segments if segment.radius_m]
    assert min(radii) > 0.5 * track.width_m + track.verge_m


@pytest.mark.parametrize("name", shipped_tracks())
def test_the_centre_line_is_a_smooth_ring_of_the_tracks_length(name: str) -> None:
    track = load_track(name)
    line = centre_line(track)
    steps = np.diff(line.path.points_m, axis=0, append=line.path.points_m[:1])
    assert np.hypot(*steps.T).sum() / SCALE == pytest.approx(track.length_m, rel=5e-3)
    along = np.arctan2(steps[:, 1], steps[:, 0])
    assert np.abs(np.asarray(wrap_angle(along - line.path.headings_rad))).max() < math.radians(4.0)
    inside = (line.path.points_m > 0.0) & (line.path.points_m < line.size_m)
    assert inside.all()


def test_the_curvature_adds_up_to_one_turn() -> None:
    line = centre_line(load_track("forest"))
    spacing_m = line.path.length_m / len(line.curvature)
    assert line.curvature.sum() * spacing_m == pytest.approx(math.tau, rel=0.02)


@given(st.lists(st.floats(-0.01, 0.01), min_size=4, max_size=4))
def test_closing_changes_little(errors: list[float]) -> None:
    a, b, c, d = (1.0 + error for error in errors)
    bent = (
        Segment(50.0 * a),
        arc(20.0 * b, 180.0),
        Segment(50.0 * c),
        arc(20.0 * d, 180.0),
    )
    track = Track("bent", bent)
    closed = close(track)
    assert closed.length_m == pytest.approx(track.length_m, rel=0.02)
    assert close(closed) == closed


@pytest.mark.parametrize("name", shipped_tracks())
def test_a_mirrored_track_is_closed_and_bends_the_other_way(name: str) -> None:
    track = load_track(name)
    line, other = centre_line(track), centre_line(mirrored(track))
    np.testing.assert_allclose(other.curvature, -line.curvature)
    np.testing.assert_allclose(
        np.ptp(other.path.points_m, axis=0), np.ptp(line.path.points_m, axis=0)
    )
    assert close(mirrored(track)) == mirrored(track)
    assert mirrored(mirrored(track)).segments == track.segments


def test_an_open_track_is_refused_with_its_gap() -> None:
    with pytest.raises(MapError, match="returns to its start"):
        close(Track("open", (*OVAL[:3], arc(20.0, 90.0))))
    line = centre_line(Track("nearly", (Segment(50.5), *OVAL[1:])))
    end_m = np.hypot(*(line.path.points_m[0] - line.path.points_m[-1])) / SCALE
    assert end_m == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize(
    "segments", [(), (Segment(-1.0),), (arc(0.0, 90.0),), (Segment(5.0, 5.0, 90.0),)]
)
def test_impossible_segments_are_refused(segments: tuple[Segment, ...]) -> None:
    with pytest.raises(MapError, match="above 0"):
        Track("impossible", segments)


def test_unknown_names_and_keys_name_the_nearest(tmp_path: Path) -> None:
    with pytest.raises(MapError, match="'forest'"):
        load_track("forrest")
    file = tmp_path / "wrong.yaml"
    file.write_text("name: wrong\nsegments:\n  - {radius_m: 20, angel_deg: 90}\n")
    with pytest.raises(ConfigError, match="'angle_deg'"):
        load_track(file)
