"""A twin: a short drive of a robot of a known look is enough to find it."""

from __future__ import annotations

import math
import pickle
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot.contract import DRIVE
from robot.errors import ConfigError, ContractError
from robot.geometry import between, compose, wrap_angle
from robot.navigation.road_map import RoadMap, load_map
from robot.recording import topics
from robot.recording.drive_file import DriveFile, png
from robot.recording.reader import Piece, cut, entries, mark
from robot.recording.topics import Turn
from sim_pybullet.look import (
    NOMINAL,
    CameraLook,
    DriveLook,
    GroundLook,
    Look,
    SensorLook,
    TimingLook,
)
from sim_pybullet.motors import PHYSICS_DT_S
from sim_pybullet.painting.ground import paint_ground
from sim_pybullet.randomise import load_look_sampler
from sim_pybullet.scene import Scene
from sim_pybullet.sensing.sensor import apply_sensor
from tests import thorough
from tests.trainer.virtual_drive import record_drive
from trainer.twin import camera, eye, fit
from trainer.twin.camera import Fitted, agreed, descend, distinct, placed
from trainer.twin.colours import fit_colours, members, seen_from
from trainer.twin.eye import USUAL, cover_scene, far, views_of
from trainer.twin.fit import (
    EYE_PIECE_S,
    Twin,
    believed,
    camera_delay,
    colours_told,
    fit_twin,
    looked_at,
    write_twin,
)
from trainer.twin.motion import (
    NAMES,
    Motion,
    Told,
    at_times,
    fit_motion,
    from_above,
    obeyed,
    pieces,
    reckoned,
    smoothed,
    surer,
)
from trainer.twin.recorded import Recorded, UnfitError, read_drive, read_drives

OWN = replace(
    NOMINAL,
    camera=CameraLook(height_m=0.118, pitch_rad=0.40, yaw_rad=0.03, focal_scale=0.95),
    drive=DriveLook(gain=0.93, trim=0.03, turn_gain=0.95, delay_s=0.05),
    timing=TimingLook(camera_delay_s=0.06),
    sensor=SensorLook(noise=3.0, vignetting=0.2),
)


def commands(seconds: float, rng: np.random.Generator) -> np.ndarray:
    """Rim speeds (K, 2) that change by jerks."""
    jerks = rng.uniform(0.05, 0.35, (round(seconds / 0.5), 2))
    return np.repeat(jerks, round(0.5 / PHYSICS_DT_S), axis=0)


@pytest.mark.parametrize("lasting_s", [(40.0,), (22.0, 31.0)])
def test_the_motors_of_known_drives_are_found(lasting_s: tuple[float, ...]) -> None:
    rng = np.random.default_rng(0)
    true = np.array((0.95, 0.02, 1.05, 0.12, 0.1, 0.1, 0.0, 0.0, 0.0))
    drives = []
    for seconds in lasting_s:
        driven = commands(seconds, rng)
        track = reckoned(driven, true[None])[0]
        times_s = np.arange(10, round(10 * seconds) - 10) * 0.1
        grid_s = np.arange(len(track)) * PHYSICS_DT_S + true[5]
        told = [np.interp(times_s, grid_s, part) for part in track.T]
        noise = rng.normal(0.0, (0, 0.01, 0.01, 0.03), (len(times_s), 4))
        drives.append(from_above(driven, np.column_stack((times_s, *told)) + noise))
    found = fit_motion(drives, eye=False)
    off = dict(zip(NAMES, np.abs(found.values - true), strict=False))
    assert off["gain"] < 0.01
    assert off["trim"] < 0.004
    assert off["turn_gain"] < 0.02
    assert off["delay_s"] + off["turn_lag_s"] < 0.06


def jerky(seconds: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Motors (9,), commands, the way they lead, and moments [s] of which something is told."""
    true = np.array((0.95, 0.02, 1.05, 0.12, 0.1, 0.1, 0.0, 0.0, 0.0))
    driven = commands(seconds, np.random.default_rng(0))
    track = reckoned(driven, true[None])[0]
    return true, driven, track, np.arange(10, round(10 * seconds) - 10) * 0.1


def test_a_reckoned_way_is_the_arc_that_its_wheels_roll() -> None:
    """To the left where the right wheel is faster; v = 0.15 m/s, w = 0.1 m/s over the baseline."""
    known = np.array((1.0, 0.0, 1.0, PHYSICS_DT_S, PHYSICS_DT_S, 0.0, 0.0, 0.0, 0.0))
    track = reckoned(np.tile((0.1, 0.2), (180, 1)), known[None])[0]
    rate_radps = 0.1 / DRIVE.baseline_m
    turned, radius_m = rate_radps * 60 * PHYSICS_DT_S, 0.15 / rate_radps
    arc = (radius_m * math.sin(turned), radius_m * (1.0 - math.cos(turned)), turned)
    assert between(track[100:101], track[160:161])[0] == pytest.approx(arc, abs=2e-4)


def test_who_is_late_tells_where_the_robot_was_before() -> None:
    track = np.column_stack([np.arange(91.0) * PHYSICS_DT_S] * 3)
    told = at_times(track, np.array((1.0, 2.0)), 0.25)
    assert told == pytest.approx(np.array([[0.75] * 3, [1.75] * 3]))


def test_a_look_lies_two_deviations_around_what_was_found_and_no_time_below_0() -> None:
    found: dict[str, tuple[Any, float]] = {"drive.gain": (1.0, 0.05), "drive.delay_s": (0.01, 0.02)}
    unseen: Any = None
    told = Twin(found, (), unseen, np.zeros(0), ()).plain()["drive"]
    assert told["gain"] == {"uniform": [0.9, 1.1]}
    assert told["delay_s"] == {"uniform": [0.0, 0.05]}


def test_a_robot_stands_in_pictures_before_its_first_command() -> None:
    driven = np.zeros((120, 2))
    driven[60:] = 0.1  # from 2 s on
    times_s, none = np.arange(40) * 0.1, np.zeros((0, 4))
    drive = Recorded("", driven, times_s, np.arange(40), none, none, 0.0, ())
    assert fit._still(drive) == list(range(21))


def test_a_way_bends_between_the_poses_that_tell_it() -> None:
    true, driven, track, times_s = jerky(20.0)
    told = from_above(driven, np.column_stack((times_s, at_times(track, times_s, true[5]))))
    way = smoothed(told, Motion(true, true))
    after_s = np.arange(60, 500) * PHYSICS_DT_S
    off = at_times(way, after_s) - at_times(track, after_s, true[5])
    assert np.abs(off[:, :2]).max() < 1e-3
    assert np.abs(off[:, 2]).max() < math.radians(0.1)  # 1.4 degrees as chords of a fifth second


def test_the_delay_of_pictures_is_told_by_headings() -> None:
    """Also where it is not known how soon the robot gets faster."""
    late_s, rng = 0.07, np.random.default_rng(3)
    true, driven, track, times_s = jerky(80.0)
    poses = at_times(track, times_s, true[5] + late_s)
    seen = Told(driven, times_s, poses, np.tile(300.0 * np.eye(3), (len(poses), 1, 1)), 3.0)
    overhead = np.column_stack((times_s, at_times(track, times_s, true[5])))
    error = np.zeros(3)
    for row in overhead:
        error = 0.95 * error + 0.31 * rng.normal(0.0, (0.03, 0.03, 0.09))
        row[1:] += error
    nothing = np.zeros((0, 4))
    drive = Recorded("", driven, times_s, nothing, overhead, nothing, 0.0, ())
    slow = true + np.array((0.0, 0.0, 0.0, 0.15, 0.0, late_s, 0.0, 0.0, 0.0))
    found_s, sd_s = camera_delay([drive], [seen], Motion(slow, slow))
    assert sd_s < 0.012
    assert found_s == pytest.approx(late_s, abs=2.0 * sd_s)


@given(st.floats(20.0, 1_800.0), st.floats(8.0, 30.0), st.integers(1, 20))
def test_what_is_looked_at_of_a_drive_of_any_length_tells_of_its_pieces(
    seconds: float, rate_hz: float, drives: int
) -> None:
    times_s = np.arange(round(seconds * rate_hz)) / rate_hz
    few = looked_at(times_s, drives)
    assert len(few) <= max(400 // drives, 40)
    assert (np.diff(few) > 0).all()
    told = pieces(times_s[few], EYE_PIECE_S)
    assert sum(map(len, told)) >= 20  # the motion is told of the wheels between pictures
    assert times_s[few[-1]] - times_s[few[0]] > 0.8 * seconds - 2.0 * EYE_PIECE_S


def test_motors_are_told_by_most_poses_also_where_some_are_far_off() -> None:
    """And lag from delay, where poses are sure; they count for as sure as they prove."""
    true, driven, track, times_s = jerky(80.0)
    rng = np.random.default_rng(1)
    poses = at_times(track, times_s, true[5]) + rng.normal(0.0, (2e-3, 2e-3, 4e-3), (780, 3))
    poses[::12] += rng.normal(0.0, (0.1, 0.1, 0.3), (65, 3))
    found = fit_motion([from_above(driven, np.column_stack((times_s, poses)))], eye=False)
    off = np.abs(found.values - true)
    assert found.scale < 0.2  # of 3 cm and 5 degrees
    assert (off[:6] < (3e-3, 1e-3, 5e-3, 0.03, 0.025, 0.02)).all()
    assert (off[:6] < 4.0 * found.sd[:6]).all()
    assert surer(from_above(driven, np.zeros((1, 4))), found.scale).piece_s < 4.0
    pictures = believed(found)  # of whom overhead poses told, which err alike for seconds
    assert pictures.values[5] - found.values[5] == pytest.approx(0.04)
    assert pictures.sd[5] > 0.04
    assert (pictures.sd[:5] > 5.9 * found.sd[:5]).all()


def test_motors_are_told_by_a_drive_that_was_cut_in_many_places() -> None:
    """What was commanded there is not what was commanded last: a delay of 0.1 s became one of 0.2.

    Nor does the way lead from before a cut to behind it.
    """
    true, driven, track, times_s = jerky(80.0)
    poses = at_times(track, times_s, true[5])
    steps_s = np.arange(len(driven)) * PHYSICS_DT_S
    gone = times_s % 7.0 > 5.0
    poses[gone] = np.nan
    left = driven.copy()
    left[steps_s % 7.0 > 5.0] = np.nan
    noise = np.random.default_rng(1).normal(0.0, (2e-3, 2e-3, 4e-3), (len(poses), 3))
    told = from_above(left, np.column_stack((times_s, poses + noise))[~gone])
    found = fit_motion([told], eye=False)
    off = np.abs(found.values - true)
    assert (off[:6] < (4e-3, 1e-3, 6e-3, 0.04, 0.04, 0.03)).all()
    assert obeyed(told) > 0.9
    way = smoothed(surer(told, found.scale), found)
    after_s = times_s[~gone & (times_s > 2.0) & (times_s < 78.0)]
    missed = at_times(way, after_s) - at_times(track, after_s, true[5])
    assert np.abs(missed[:, :2]).max() < 0.03  # close behind a cut
    assert np.median(np.abs(missed[:, :2])) < 0.002


def test_motors_without_lag_are_known_to_have_none() -> None:
    """Below a step of physics no lag changes anything: a fit that came there learned no more."""
    true, driven, _, times_s = jerky(40.0)
    true = true - np.array((0.0, 0.0, 0.0, 0.1, 0.08, 0.0, 0.0, 0.0, 0.0))
    poses = at_times(reckoned(driven, true[None])[0], times_s, true[5])
    poses += np.random.default_rng(2).normal(0.0, (2e-3, 2e-3, 4e-3), poses.shape)
    found = fit_motion([from_above(driven, np.column_stack((times_s, poses)))], eye=False)
    assert (found.values[3:5] < 0.07).all()  # of 0.1 to begin with
    assert (found.sd[3:5] < 0.03).all()


def test_motors_that_never_ran_stay_as_unsure_as_before() -> None:
    stood = np.zeros((900, 2))
    told = np.column_stack((np.arange(290) * 0.1, np.ones((290, 3))))
    found = fit_motion([from_above(stood, told)], eye=False)
    assert found.sd[0] == pytest.approx(0.15, rel=0.2)  # as wide as it began
    assert found.sd[1] == pytest.approx(0.06, rel=0.2)


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return record_drive(OWN, "rings/claw", 40.0, 1, tmp_path_factory.mktemp("twin") / "own.mcap")


def test_a_recording_has_what_a_fit_needs(recording: Path) -> None:
    drive = read_drive(recording)
    assert drive.images.shape[1:] == (120, 160, 3)
    assert len(drive.images) == len(drive.times_s) == len(drive.turns) > 300
    assert drive.seconds == pytest.approx(40.0, abs=0.3)
    delays_s = np.diff(drive.overhead[:, 0])
    assert np.median(delays_s) == pytest.approx(0.1)


def test_what_was_cut_out_of_a_drive_was_driven_by_no_command(
    recording: Path, tmp_path: Path
) -> None:
    """It had counted as driven by the last one before."""
    whole, copied = read_drive(recording), tmp_path / "marked.mcap"
    copied.write_bytes(recording.read_bytes())
    began_s = next(iter(entries(copied, topics.TURN))).time_s
    bad = [Piece(began_s + at_s, began_s + at_s + 3.0, "bad") for at_s in (9.0, 21.0)]
    mark(copied, bad)
    cut(copied, tmp_path / "cut.mcap")
    left = read_drive(tmp_path / "cut.mcap")
    assert left.seconds == pytest.approx(whole.seconds - 6.0, abs=0.5)
    lost_s = np.flatnonzero(np.isnan(left.commands[:, 0])) * PHYSICS_DT_S
    assert ((lost_s % 12.0) > 8.8).all()
    kept = ~np.isnan(left.commands[:, 0])
    same = np.abs(left.commands - whole.commands[: len(left.commands)])[kept].max(axis=1) < 1e-9
    assert same.mean() > 0.95  # all but what follows a cut: no ramp leads there from before it
    for k in np.flatnonzero(np.diff(np.isnan(left.commands[:, 0]).astype(int)) < 0) + 1:
        asked = {turn.wheels for turn in left.turns}
        assert any(np.allclose(left.commands[k], wheels) for wheels in asked)


def test_commands_are_read_as_the_robots_ramp_lets_wheels_follow_them(tmp_path: Path) -> None:
    look = replace(OWN, drive=replace(OWN.drive, acceleration_mps2=0.8))
    drive = read_drive(record_drive(look, "rings/claw", 40.0, 1, tmp_path / "ramp.mcap"))
    gained = np.abs(np.diff(drive.commands, axis=0)).max()
    assert gained == pytest.approx(0.8 * PHYSICS_DT_S)
    assert drive.acceleration_mps2 == 0.8


def test_a_picture_that_comes_once_more_tells_nothing_new(tmp_path: Path) -> None:
    """A camera may give what it gave before, under a number of its own."""
    file = DriveFile(tmp_path / "again.mcap", {"map": ""})
    picture = np.zeros((120, 160, 3), np.uint8)
    for k in range(90):
        picture[0, 0, 0] = k if k % 3 else k - 1 if k else 0
        file.add(topics.CAMERA, 0.1 * k, topics.image_message(0.1 * k, png(picture), "png"), k)
        turn = Turn(k, 0.1 * k, 0.01, 0.0, "MANUAL", "", "", (0.1, 0.1), frame=k)
        file.add(topics.TURN, 0.1 * k, turn.plain(), k)
    file.close()
    drive = read_drive(tmp_path / "again.mcap")
    assert drive.skipped == pytest.approx(29 / 90)
    assert [turn.number for turn in drive.turns] == [k for k in range(90) if k % 3 or not k]
    assert len(drive.images) == len(drive.times_s) == 61


def driven(file: Path, size: tuple[int, int] = (120, 160), pictures: bool = True) -> Path:
    """Nine seconds by hand."""
    made = DriveFile(file, {"map": ""})
    for k in range(90):
        shade = np.full((*size, 3), k, np.uint8)
        if pictures:
            made.add(topics.CAMERA, 0.1 * k, topics.image_message(0.1 * k, png(shade), "png"), k)
        turn = Turn(k, 0.1 * k, 0.01, 0.0, "MANUAL", "", "", (0.1, 0.1), frame=k)
        made.add(topics.TURN, 0.1 * k, turn.plain(), k)
    made.close()
    return file


def test_what_is_marked_bad_was_driven_by_nobody(tmp_path: Path) -> None:
    mark(path := driven(tmp_path / "own.mcap"), [Piece(2.0, 3.0, "bad")])
    states = [turn.state for turn in read_drive(path).turns]
    assert states == ["MANUAL"] * 20 + [""] * 10 + ["MANUAL"] * 60


def test_pictures_of_another_size_are_cut_as_a_robots_are(tmp_path: Path) -> None:
    assert read_drive(driven(tmp_path / "own.mcap", (240, 400))).images.shape == (90, 120, 160, 3)


def test_a_recording_without_a_picture_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UnfitError, match="8 s and more of driving"):
        read_drive(driven(tmp_path / "own.mcap", pictures=False))


@pytest.mark.parametrize(
    ("topic", "message"),
    [
        (topics.CAMERA, {"data": "zzz", "format": "jpeg"}),
        (topics.CAMERA, {"header": {}}),
        (topics.POSE, {"pose": {"position": {}}}),  # before any turn
    ],
)
def test_what_another_program_recorded_is_refused(
    topic: topics.Topic, message: dict[str, Any], tmp_path: Path
) -> None:
    file = DriveFile(tmp_path / "other.mcap", {})
    file.add(topic, 1.0, message, 0)
    file.close()
    with pytest.raises(ContractError, match=r"other\.mcap: expected a robot's recording, got: "):
        read_drives([file.path], pytest.fail)


def test_an_error_of_ours_is_not_told_as_one_of_the_recording(
    recording: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("trainer.twin.recorded.fit_to_frame", lambda image: image + None)
    with pytest.raises(TypeError):
        read_drives([recording], pytest.fail)


@pytest.fixture(scope="module")
def short(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return record_drive(NOMINAL, "rings/claw", 2.0, 1, tmp_path_factory.mktemp("twin") / "s.mcap")


def test_a_short_recording_is_refused(short: Path) -> None:
    with pytest.raises(UnfitError, match="8 s and more of driving"):
        read_drive(short)


def test_short_recordings_among_others_are_left_out_and_told(recording: Path, short: Path) -> None:
    told: list[str] = []
    (drive,) = read_drives([short, recording, short], told.append)
    assert drive.seconds > 39.0
    assert len(told) == 2
    assert all(line.startswith(f"left out: {short}: expected 8 s") for line in told)
    for paths in ([short], []):
        with pytest.raises(ConfigError, match="expected 20 s and more of drives, got 0 s"):
            read_drives(paths, told.append)


def test_missions_of_some_seconds_count_together(tmp_path: Path) -> None:
    """A robot records each mission by itself."""
    path = record_drive(NOMINAL, "rings/claw", 12.0, 1, tmp_path / "mission.mcap")
    assert len(read_drives([path, path], pytest.fail)) == 2
    with pytest.raises(ConfigError, match="expected 20 s and more of drives, got 12 s"):
        read_drives([path], pytest.fail)


@pytest.mark.slow
def test_the_look_of_a_known_robot_is_found(
    recording: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fit, "TRACKED", 200)  # of a short drive fewer are enough
    monkeypatch.setattr(fit, "KEY_PICTURES", 15)
    monkeypatch.setattr(camera, "TRIED_RAD", camera.TRIED_RAD[1::2])
    twin = fit_twin([read_drive(recording)])
    found: Look = twin.look
    assert found.camera.height_m == pytest.approx(OWN.camera.height_m, abs=0.004)
    middle = found.camera.pitch_rad - found.camera.centre_down_px / 76.0
    assert middle == pytest.approx(OWN.camera.pitch_rad, abs=0.015)
    assert found.camera.yaw_rad - found.camera.centre_right_px / 76.0 == pytest.approx(
        0.03, abs=0.03
    )
    gain, sd = twin.found["drive.gain"]  # of 200 pictures, so it is not sure of it
    assert sd < 0.015
    assert gain == pytest.approx(0.93, abs=3.0 * sd)
    assert found.drive.trim == pytest.approx(0.03, abs=0.005)
    assert found.sensor.noise == pytest.approx(3.0, abs=1.0)
    assert np.abs(np.subtract(found.ground.asphalt_rgb, OWN.ground.asphalt_rgb)).max() < 8
    out = tmp_path / "own.yaml"
    write_twin(twin, out)
    draws = [load_look_sampler(out)(np.random.default_rng(k)) for k in range(8)]
    assert np.std([look.sensor.blur_px for look in draws]) > 0.1  # unseen: as wide as randomised
    assert np.std([look.camera.height_m for look in draws]) < 0.005


def test_steering_that_is_written_down_the_wrong_way_round_is_refused(tmp_path: Path) -> None:
    half = record_drive(NOMINAL, "rings/claw", 40.0, 1, tmp_path / "half.mcap", reverse=0.5)
    with pytest.raises(ConfigError, match="the wrong way round"):
        fit_twin([read_drive(half)])


def test_what_burns_out_does_so_in_shaded_corners_too() -> None:
    """Else a twin would draw grey what the camera showed white."""
    drawn = np.zeros((2, 120, 160, 3), np.uint8)
    drawn[..., 80:, 0] = 255  # white on the right, else road
    levels = np.where(drawn[..., :1] > 0, (300.0, 200.0, 310.0), (60.0, 55.0, 50.0))
    pictures = (levels * (1.0 - 0.3 * far())[..., None]).clip(0.0, 255.0).astype(np.uint8)
    found = fit_colours(pictures, drawn, 0.3, [])
    shade = 1.0 - 0.3 * far()
    for kind, mask in members(drawn).items():
        if kind in found.rgb:
            again = (found.rgb[kind] * shade[..., None]).clip(0.0, 255.0) * np.ones((2, 1, 1, 1))
            assert np.abs(again[mask] - pictures[mask]).max() < 10.0
    assert found.rgb["white"][1] == pytest.approx(200.0, abs=4.0)
    assert max(found.rgb["white"]) > 290.0
    own = Fitted(USUAL, USUAL, np.zeros((1, 3)), 1.0, 0.0)
    told = colours_told(found, own, [])
    exposure, _ = told["sensor.exposure"]
    assert exposure * np.array(told["ground.white_rgb"][0]) == pytest.approx(
        found.rgb["white"], 5e-3
    )
    assert max(told["ground.white_rgb"][0]) <= 255.0
    assert colours_told(found._replace(rgb={}), own, [])["sensor.exposure"][0] == 1.0


@thorough.only
def test_a_wrong_minimum_is_not_believed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fit, "KEY_PICTURES", 15)  # enough to fall into the wrong one
    monkeypatch.setattr(fit, "TRACKED", 40)  # pictures that tell how it moved, not what it sees by
    look = load_look_sampler("wide/day")(np.random.default_rng((0, 1)))  # paint like the road
    path = record_drive(look, "rings/claw", 40.0, 1, tmp_path / "bright.mcap")
    found = fit_twin([read_drive(path)]).found  # from the usual height it found one 40 mm lower
    if "camera.height_m" in found:
        assert found["camera.height_m"][0] == pytest.approx(look.camera.height_m, abs=0.008)


@thorough.only
@pytest.mark.parametrize(
    "seeds",
    [
        (4, 321, 4),  # by twelve pictures a camera 18 mm lower
        (6000, 1, 6001),  # one 45 mm higher explains more of them, if the robot was elsewhere
        (0, 28, 28),  # by six pictures seven others, 18 to 48 mm lower, seem better
    ],
)
def test_the_best_camera_is_chosen(
    seeds: tuple[int, int, int], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fit, "TRACKED", 40)
    look = load_look_sampler("wide/day")(np.random.default_rng(seeds[:2]))
    path = record_drive(look, "rings/claw", 90.0, seeds[2], tmp_path / "day.mcap")
    found = fit_twin([read_drive(path)]).look.camera
    assert found.height_m == pytest.approx(look.camera.height_m, abs=0.004)
    assert found.pitch_rad == pytest.approx(look.camera.pitch_rad, abs=0.015)


def test_of_those_that_are_one_camera_the_best_goes_on() -> None:
    best = Fitted(USUAL, USUAL, np.zeros((1, 3)), 0.95, 1.0)
    near, lower, higher = (best._replace(values=USUAL.copy(), cost=c) for c in (2.0, 3.0, 4.0))
    near.values[0] += 0.009
    px_per_rad = 76.0
    lower.values[[1, 6]] += 0.1, 0.1 * px_per_rad  # the same middle
    higher.values[0] += 0.02
    assert distinct([higher, lower, near, best]) == [best, higher]


@given(st.integers(0, 2**31 - 1))
def test_a_picture_that_pulls_away_from_the_others_hardly_counts(seed: int) -> None:
    rng = np.random.default_rng(seed)
    spread, step = camera.SPREAD, 0.5 * camera.SPREAD * rng.uniform(-1.0, 1.0, len(USUAL))
    roots = rng.normal(size=(20, 12, len(USUAL))) * 20.0 / spread
    matrices = np.swapaxes(roots, 1, 2) @ roots
    aims = step + 0.02 * spread * rng.normal(size=(20, len(USUAL)))
    aims[7] += 3.0 * spread
    pulls = (matrices @ aims[..., None])[..., 0]
    _, found = agreed(matrices, pulls, np.zeros(len(USUAL)))
    assert np.abs((found - step) / spread).max() < 0.05  # 0.15 and more, did all count alike


def worn_pictures(values: np.ndarray, count: int = 12) -> tuple[RoadMap, np.ndarray, np.ndarray]:
    """A map, poses on it, and what a camera sees there of a floor that has seen better days."""
    road_map = load_map("rings/claw")
    paint = GroundLook(
        line_width_scale=float(values[eye.WIDTH]),
        wear=0.5,
        gaps=0.2,
        shadows=0.6,
        patchiness=0.5,
        grain=12.0,
    )
    starts = [lane.control_points_m for lane in road_map.lanes[::2]][:count]
    poses = np.array([(*a, math.atan2(*(b - a)[::-1])) for a, b, *_ in starts])
    scene = Scene(paint_ground(road_map, paint), (), NOMINAL.sky, NOMINAL.light)
    sensor = SensorLook(blur_px=0.9, noise=8.0, jpeg_quality=60, exposure=1.4)
    drawn = seen_from(scene, values, poses)
    return road_map, poses, apply_sensor(drawn, [sensor] * count, np.random.default_rng(0))


def test_pitch_is_told_from_the_lens_and_the_width_of_lines_by_steps_along_their_valley() -> None:
    """Who looks lower through a lens that sits higher sees nearly the same."""
    true = USUAL + np.array((0.01, 0.04, 0.02, 0.03, 0.1, 1.0, 1.5, 0.15, -0.15))
    road_map, poses, images = worn_pictures(true)
    begin = true + np.array((0.008, -0.08, 0.0, 0.0, 0.0, 0.0, -6.5, -0.15, 0.1))
    found = descend(views_of(list(images), poses, road_map), begin, 8, poses).values
    assert found[0] == pytest.approx(true[0], abs=0.002)
    assert found[1] == pytest.approx(true[1], abs=0.025)  # 0.04 by plain steps
    assert found[7] == pytest.approx(true[7], abs=0.06)


def test_cover_grows_with_the_width_of_lines_by_less_than_a_texel() -> None:
    """Painted in whole texels it stays, or jumps, and the width never settles."""
    road_map = load_map("rings/claw")
    rgbs = [cover_scene(road_map, width).ground.rgb for width in (1.0, 1.01, 1.02, 1.03)]
    white = np.array([rgb[..., 0].sum(dtype=float) for rgb in rgbs])
    grown = np.diff(white) / white[0]
    assert grown == pytest.approx(0.01, rel=0.1)


def test_slopes_tell_how_the_drawing_changes_with_camera_and_pose() -> None:
    road_map, poses, images = worn_pictures(USUAL, 1)
    views = views_of(list(images), poses, road_map)
    known, _, slopes = eye.Eye(views, USUAL, True).look(poses[0])
    ways = np.diag((1e-3, 3e-3, 3e-3, 3e-3, 15e-3, 0.2, 0.2, 0.05, 0.05, 2e-3, 2e-3, 5e-3))
    for way, slope in zip(ways, slopes, strict=True):
        ends = (
            eye.Eye(views, USUAL + sign * way[:9], False).look(poses[0] + sign * way[9:])[1]
            for sign in (1.0, -1.0)
        )
        changed = np.subtract(*ends).reshape(-1, 3)[known].ravel() / (2.0 * way.sum())
        told = eye._unlit(slope, 1).reshape(-1, 3)[known].ravel()
        assert changed @ told / (told @ told) == pytest.approx(1.0, abs=0.05)


def test_light_that_is_large_does_not_tilt_the_camera() -> None:
    """A lamp's spot on a bright floor, shadows and patches: 0.3 degrees where these counted."""
    road_map = load_map("rings/claw")
    starts = [lane.control_points_m for lane in road_map.lanes[::2]][:24]
    poses = np.array([(*a, math.atan2(*(b - a)[::-1])) for a, b, *_ in starts])
    paint = GroundLook(
        asphalt_rgb=(140.0, 130.0, 130.0),
        white_rgb=(190.0, 190.0, 190.0),
        yellow_rgb=(215.0, 115.0, 55.0),
        outside_rgb=(90.0, 100.0, 190.0),
        patchiness=0.8,
        shadows=0.6,
        wear=0.2,
    )
    scene = Scene(paint_ground(road_map, paint), (), NOMINAL.sky, NOMINAL.light)
    rows, columns = np.mgrid[:120, :160]
    spots = [
        120.0 * np.exp(-((rows - 75) ** 2 + (columns - x) ** 2) / 500.0)
        for x in np.linspace(20, 140, len(poses))
    ]
    lit = seen_from(scene, USUAL, poses) + np.array(spots)[..., None]
    images = lit.clip(0.0, 255.0).astype(np.uint8)
    found = descend(views_of(list(images), poses, road_map), USUAL, 6, poses).values
    assert abs(found[1] - USUAL[1]) < math.radians(0.12)
    assert found[0] == pytest.approx(USUAL[0], abs=4e-4)


def test_shaded_corners_do_not_tilt_the_camera() -> None:
    """They are flat, too: where that was not known they did, by 0.2 degrees here."""
    road_map = load_map("rings/claw")
    starts = [lane.control_points_m for lane in road_map.lanes[::2]][:24]
    poses = np.array([(*a, math.atan2(*(b - a)[::-1])) for a, b, *_ in starts])
    paint = GroundLook(asphalt_rgb=(120.0, 118.0, 115.0), outside_rgb=(210.0, 205.0, 190.0))
    scene = Scene(paint_ground(road_map, paint), (), NOMINAL.sky, NOMINAL.light)
    shaded = [SensorLook(vignetting=0.35)] * len(poses)
    images = apply_sensor(seen_from(scene, USUAL, poses), shaded, np.random.default_rng(0))
    found = descend(views_of(list(images), poses, road_map), USUAL, 6, poses).values
    assert abs(found[1] - USUAL[1]) < math.radians(0.12)
    assert found[-1] == pytest.approx(0.35, abs=0.05)


def test_pictures_find_their_places_from_where_the_robot_was_a_little_before() -> None:
    road_map, poses, images = worn_pictures(true := np.array((*USUAL[:-1], 0.0)), 24)
    late = compose(poses, np.array([(-0.012, 0.0, 0.06)]))  # 40 ms, in a bend
    found, _, _ = placed(list(images), late, road_map, true, (*camera.AFAR, 1))
    missed_rad = np.abs(wrap_angle(found[:, 2] - poses[:, 2]))
    assert np.median(missed_rad) < 0.009  # a seventh; a third after three steps


def test_pictures_find_their_places_from_farther_in_small_pictures_first() -> None:
    """A line several pixels away has no slope."""
    road_map, poses, images = worn_pictures(true := np.array((*USUAL[:-1], 0.0)), 24)
    away = compose(poses, np.array([(0.0, 0.03, 0.1)]))
    near, afar = (
        np.median(np.hypot(*(placed(list(images), away, road_map, true, how)[0] - poses)[:, :2].T))
        for how in ((1, 1, 1), (*camera.AFAR, 1))
    )
    assert afar < 0.02
    assert afar < 0.5 * near


def test_a_camera_costs_more_for_which_the_robot_was_elsewhere_than_it_was_told() -> None:
    road_map, poses, images = worn_pictures(USUAL)
    views = views_of(list(images[:4]), poses[:4], road_map)
    told_elsewhere = views._replace(poses=poses[:4] + np.array((0.08, 0.08, 0.0)))
    here, elsewhere = (descend(v, USUAL, 1, poses[:4]) for v in (views, told_elsewhere))
    assert elsewhere.share == pytest.approx(here.share, abs=0.05)  # the pictures are the same
    assert elsewhere.cost > here.cost + 0.2


def test_pictures_that_processes_share_tell_the_same_as_alone(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    road_map, poses, images = worn_pictures(USUAL, 8)
    both = [np.concatenate((each, each)) for each in (images, poses)]
    views = views_of(list(both[0]), both[1], road_map, shrink=2)

    def spread(do: Any, *orders: Any) -> list[Any]:
        """From the last to the first; each in a process's own memory."""
        each = [pickle.dumps((do, order)) for order in zip(*orders, strict=False)]
        assert len(each) == 4
        return [do(*order) for do, order in map(pickle.loads, reversed(each))][::-1]

    found = []
    for piece, way in ((100, map), (4, spread)):
        monkeypatch.setattr(camera, "PIECE", piece)
        found.append(descend(views, USUAL, 2, None, way))
    alone, shared = found
    assert np.array_equal(alone.values, shared.values)
    assert np.array_equal(alone.poses, shared.poses)
