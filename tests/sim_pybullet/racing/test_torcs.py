"""TORCS tracks: a sample of our own, and the real ones where the game is installed.

``DUCKPILOT_TORCS`` names the folder of its tracks where it is elsewhere.
"""

import math
import os
from pathlib import Path

import pytest

from robot.errors import ConfigError
from sim_pybullet.racing.torcs import INSTALLED, parse_torcs, read_torcs
from sim_pybullet.racing.track import CLOSED_M, Arc, Straight, Track, load_track

SAMPLE = """<?xml version="1.0" encoding="UTF-8"?>
<!-- a stadium with one bend that tightens -->
<!DOCTYPE params SYSTEM "../params.dtd" [
<!ENTITY default-surfaces SYSTEM "surfaces.xml">
]>
<params name="sample" type="trackdef">
  <section name="Surfaces">&default-surfaces;</section>
  <section name="Main Track">
    <attnum name="width" unit="m" val="14.0"/>
    <attnum name="profil steps length" unit="m" val="4"/>
    <section name="Left Side"><attnum name="width" unit="m" val="3.0"/></section>
    <section name="Right Side"><attnum name="width" unit="m" val="20.0"/></section>
    <section name="Track Segments">
      <section name="start">
        <attstr name="type" val="str"/><attnum name="lg" unit="m" val="100"/>
      </section>
      <section name="bend">
        <attstr name="type" val="lft"/><attnum name="arc" unit="deg" val="180"/>
        <attnum name="radius" unit="m" val="40"/>
      </section>
      <section name="back">
        <attstr name="type" val="str"/><attnum name="lg" unit="ft" val="328.084"/>
      </section>
      <section name="first half">
        <attstr name="type" val="lft"/><attnum name="arc" val="1.5707963"/>
        <attnum name="radius" unit="m" val="42"/><attnum name="end radius" unit="m" val="38.1"/>
      </section>
      <section name="second half">
        <attstr name="type" val="lft"/><attnum name="arc" unit="deg" val="90"/>
        <attnum name="radius" unit="m" val="38.1"/><attnum name="end radius" unit="m" val="42"/>
      </section>
    </section>
  </section>
</params>
"""


def test_the_sample_is_read_as_it_is_written() -> None:
    track = parse_torcs(SAMPLE, "sample.xml")
    assert (track.name, track.width_m, track.verge_m) == ("sample", 14.0, 3.0)
    assert track.segments[:2] == (Straight(100.0), Arc(40.0, pytest.approx(180.0)))
    assert track.segments[2] == Straight(pytest.approx(100.0, abs=1e-3))
    spiral = track.segments[3 : 3 + len(track.segments[3:]) // 2]
    assert len(spiral) == int(0.5 * (42.0 + 38.1) * math.pi / 2 / 4.0) + 1
    radii = [part.radius_m for part in spiral if isinstance(part, Arc)]
    assert radii[0] == 42.0
    assert radii[-1] == pytest.approx(38.1)
    assert radii == sorted(radii, reverse=True)
    turned = sum(part.angle_deg for part in spiral if isinstance(part, Arc))
    assert turned == pytest.approx(90.0, abs=1e-4)


def check_closed(track: Track, written: Track) -> None:
    """What the specification asks of every TORCS track."""
    assert track.gap_m <= CLOSED_M
    assert track.length_m == pytest.approx(written.length_m, rel=5e-3)


def test_the_sample_is_closed_and_as_long_as_its_file_says(tmp_path: Path) -> None:
    file = tmp_path / "sample.xml"
    file.write_text(SAMPLE)
    check_closed(load_track(file), parse_torcs(SAMPLE, "sample.xml"))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('val="lft"', 'val="lift"', "'lft'"),
        ("Main Track", "Main Trick", "'Main Track'"),
        ("</params>", "", "expected a TORCS track"),
    ],
)
def test_what_is_no_track_is_refused(old: str, new: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        parse_torcs(SAMPLE.replace(old, new), "sample.xml")


REAL_LENGTHS_M = {"aalborg": 2587.54, "e-track-1": 3243.64, "g-track-2": 3185.83}


@pytest.fixture
def torcs_dir() -> Path:
    path = Path(os.environ.get("DUCKPILOT_TORCS", INSTALLED))
    if not path.is_dir():
        pytest.skip(f"no TORCS tracks at {path} (apt install torcs-data, or set DUCKPILOT_TORCS)")
    return path


@pytest.mark.parametrize("name", REAL_LENGTHS_M)
def test_the_papers_tracks_have_the_lengths_that_torcs_gives_them(
    torcs_dir: Path, name: str
) -> None:
    track = read_torcs(torcs_dir / "road" / name / f"{name}.xml")
    assert track.length_m == pytest.approx(REAL_LENGTHS_M[name], rel=1e-4)


def test_all_installed_tracks_are_closed_and_as_long_as_their_files_say(torcs_dir: Path) -> None:
    files = sorted(torcs_dir.glob("*/*/*.xml"))
    assert len(files) > 20
    for file in files:
        check_closed(read_torcs(file), parse_torcs(file.read_text("latin-1"), str(file)))
