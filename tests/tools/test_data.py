"""Recorded drives: listed, divided, cut, and to and from Donkeycar's tubs."""

from __future__ import annotations

import json
import math
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from robot.contract import Stick
from robot.errors import ConfigError
from robot.recording.drive_file import DriveFile, picture
from robot.recording.reader import Piece, mark, read_pieces, read_samples
from tests.tools.recorded import recorded
from tools.data.__main__ import main
from tools.data.drives import divide, drives_in, from_tub, tell, to_tub
from trainer.run import appearing

TUB = Path(os.environ.get("DUCKPILOT_DATA", "data")) / "real/donkeycar_boards/tub"


def test_a_tub_and_back_is_the_same_drive(tmp_path: Path) -> None:
    drives = [recorded(tmp_path / "own", name) for name in ("a", "b")]
    assert to_tub(drives, tmp_path / "tub") == 60
    back = from_tub(tmp_path / "tub", tmp_path / "back")
    again = tmp_path / "again"
    to_tub(back, again)
    for there, here in zip(drives, back, strict=True):
        before, after = list(read_samples(there)), list(read_samples(here))
        assert [s.driver for s in after] == [s.driver for s in before]
        assert np.allclose([s.wheels for s in after], [s.wheels for s in before], atol=1e-12)
        assert np.allclose([s.time_s for s in after], [s.time_s for s in before], atol=1e-3)
        for one, other in zip(before, after, strict=True):
            off = picture(one.picture).astype(float) - picture(other.picture)
            assert np.abs(off).mean() < 2.0, "JPEG loses little"
    for path in (again / "images").iterdir():
        assert path.read_bytes() == (tmp_path / "tub/images" / path.name).read_bytes()


def test_a_tub_is_what_donkeycar_reads(tmp_path: Path) -> None:
    to_tub([recorded(tmp_path, "a", 40)], tub := tmp_path / "tub")
    inputs, types, metadata, head, catalogs = map(
        json.loads, (tub / "manifest.json").read_text().splitlines()
    )
    assert dict(zip(inputs, types, strict=True)) == {
        "cam/image_array": "image_array",
        "user/angle": "float",
        "user/throttle": "float",
        "user/mode": "str",
    }
    assert metadata == {}
    assert catalogs == {
        "paths": ["catalog_0.catalog"],
        "current_index": 40,
        "max_len": 1000,
        "deleted_indexes": [],
    }
    assert head["sessions"]["all_full_ids"] == ["a_0"]
    lines = (tub / "catalog_0.catalog").read_text().splitlines(keepends=True)
    about = json.loads((tub / "catalog_0.catalog_manifest").read_text())
    assert about["line_lengths"] == [len(line) for line in lines], "it seeks by these"
    record = json.loads(lines[7])
    assert (record["_index"], record["cam/image_array"]) == (7, "7_cam_image_array_.jpg")
    left, right = next(s for i, s in enumerate(read_samples(tmp_path / "a.mcap")) if i == 7).wheels
    assert record["user/angle"] == pytest.approx((left - right) / 0.102 / 2.4), "right is positive"
    assert record["user/throttle"] == pytest.approx((left + right) / 2.0 / 0.3)


@pytest.mark.skipif(not TUB.exists(), reason="no real tub here")
def test_a_real_tub_is_read_whole(tmp_path: Path) -> None:
    drives = from_tub(TUB, tmp_path / "drives")
    samples = [sample for path in drives for sample in read_samples(path)]
    assert len(samples) == 302
    assert len(drives) == 3, "two pauses of more than a second"
    images = sorted((TUB / "images").iterdir(), key=lambda path: int(path.name.split("_")[0]))
    assert [s.picture for s in samples] == [path.read_bytes() for path in images]
    to_tub(drives, tmp_path / "tub")
    rows = [
        [json.loads(line) for line in (tub / "catalog_0.catalog").read_text().splitlines()]
        for tub in (TUB, tmp_path / "tub")
    ]
    for name in ("user/angle", "user/throttle", "_timestamp_ms"):
        there, here = ([row[name] for row in of] for of in rows)
        assert np.allclose(there, here, rtol=0.0, atol=1e-9)


def test_deleted_broken_and_absent_records_are_left_out(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    to_tub([recorded(tmp_path, "a")], tub := tmp_path / "tub")
    text = (tub / "manifest.json").read_text()
    (tub / "manifest.json").write_text(
        text.replace('"deleted_indexes": []', '"deleted_indexes": [3]')
    )
    (tub / "images/5_cam_image_array_.jpg").unlink()
    with (tub / "catalog_0.catalog").open("ab") as catalog:  # as a power cut leaves it
        catalog.write(b"\0" * 40 + b'\n{"_index": 30, "cam/im')
    (drive,) = from_tub(tub, tmp_path / "back")
    assert len(list(read_samples(drive))) == 28
    told = capsys.readouterr().out
    assert "left out 3 records, such as" in told, "what is deleted is not told"
    assert "catalog_0.catalog:6: FileNotFoundError" in told


def test_a_tub_with_other_keys_is_refused_with_the_key_that_it_lacks(tmp_path: Path) -> None:
    to_tub([recorded(tmp_path, "a")], tub := tmp_path / "tub")
    catalog = tub / "catalog_0.catalog"
    catalog.write_text(catalog.read_text().replace("user/angle", "user/steering"))
    with pytest.raises(ConfigError, match=r"version 2 .* left out 30 .*:1: KeyError\('user/angle'"):
        from_tub(tub, tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("user/angle", math.nan),
        ("user/angle", None),
        ("user/throttle", math.inf),
        pytest.param("user/throttle", 10**400, id="huge"),
        ("_timestamp_ms", math.nan),
        ("_timestamp_ms", 1e30),
        ("_timestamp_ms", "now"),
        ("cam/image_array", "nul.jpg"),
        ("cam/image_array", "empty.jpg"),
        ("cam/image_array", "cut.jpg"),
        ("cam/image_array", None),
    ],
)
def test_a_record_with_figures_that_cannot_be_is_left_out(
    field: str, value: object, tmp_path: Path
) -> None:
    to_tub([recorded(tmp_path, "a")], tub := tmp_path / "tub")
    (tub / "images/nul.jpg").write_bytes(bytes(500))
    (tub / "images/empty.jpg").write_bytes(b"")
    whole = (tub / "images/0_cam_image_array_.jpg").read_bytes()
    (tub / "images/cut.jpg").write_bytes(whole[:100])
    change(tub, {field: value}, only=7)
    (drive,) = from_tub(tub, tmp_path / "back")
    assert len(list(read_samples(drive))) == 29


def change(tub: Path, fields: dict[str, object], only: int | None = None) -> None:
    """Set fields of one record, or of all."""
    catalog = tub / "catalog_0.catalog"
    records = [json.loads(line) for line in catalog.read_text().splitlines()]
    for number, record in enumerate(records):
        if only in (None, number):
            record.update(fields)
    catalog.write_text("".join(json.dumps(record) + "\n" for record in records))


@pytest.mark.parametrize(
    ("mode", "driver", "angle", "throttle"),
    [
        ("user", "person", 0.2, 0.5),
        (None, "person", 0.2, 0.5),
        ("local", "policy", -0.4, 0.9),
        ("local_angle", "policy", -0.4, 0.5),
    ],
)
def test_who_steers_and_who_gives_the_throttle_is_told_by_the_mode(
    mode: str | None, driver: str, angle: float, throttle: float, tmp_path: Path
) -> None:
    to_tub([recorded(tmp_path, "a")], tub := tmp_path / "tub")
    person = {"user/mode": mode, "user/angle": 0.2, "user/throttle": 0.5}
    change(tub, {**person, "pilot/angle": -0.4, "pilot/throttle": 0.9})
    manifest = (tub / "manifest.json").read_text()
    text = manifest.replace('"deleted_indexes": []', '"deleted_indexes": null')
    (tub / "manifest.json").write_text(text)
    (back,) = from_tub(tub, tmp_path / "back")
    sample = next(read_samples(back))
    assert sample.driver == driver
    assert tuple(Stick.of(sample.wheels)) == pytest.approx((-angle, throttle), abs=1e-6)


def test_drives_in_which_nobody_drove_are_left_out(tmp_path: Path) -> None:
    idle = DriveFile(tmp_path / "idle.mcap", {"robot": "daisy"})
    idle.close()
    drives = [idle.path, recorded(tmp_path, "a")]
    assert to_tub(drives, tmp_path / "tub") == 30
    with pytest.raises(ConfigError, match="a drive with pictures, got none"):
        to_tub(drives[:1], tmp_path / "none")
    assert main(["list", str(idle.path)]) == 0
    assert main(["plot", str(idle.path), "--out", str(tmp_path / "none.png")]) == 2
    assert not (tmp_path / "none.png").exists()


def test_a_drive_named_twice_is_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(recorded(tmp_path, "a").parent)
    assert drives_in([Path("a.mcap"), tmp_path / "a.mcap", tmp_path]) == [tmp_path / "a.mcap"]
    with pytest.raises(ConfigError, match="expected one or more, or folders of them, got none"):
        drives_in([])


def test_a_cut_replaces_no_other_recording(tmp_path: Path) -> None:
    one, other = recorded(tmp_path, "a"), recorded(tmp_path, "b")
    data = other.read_bytes()
    assert main(["cut", str(one), "--out", str(other)]) == 2
    assert other.read_bytes() == data


def test_what_is_no_tub_is_refused_and_nothing_is_left(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"manifest\.json: expected a part of the drive"):
        from_tub(tmp_path, tmp_path / "out")
    (tmp_path / "manifest.json").write_text("[]\n[]\n{}\n{}\n[1]\n")
    with pytest.raises(ConfigError, match="Donkeycar tub of version 2"):
        from_tub(tmp_path, tmp_path / "out")
    assert [path.name for path in tmp_path.iterdir()] == ["manifest.json"]


def test_a_tub_of_version_1_and_a_folder_of_tubs_are_named(tmp_path: Path) -> None:
    (tmp_path / "record_1.json").write_text("{}")
    with pytest.raises(ConfigError, match=r"of version 2, got one of version 1, .*to_tub_v2\.py"):
        from_tub(tmp_path, tmp_path / "out")
    for name in ("b", "a"):
        to_tub([recorded(tmp_path / "own", name)], tmp_path / "tubs" / name)
    with pytest.raises(ConfigError, match=r"got a folder of 2; give each alone, as .*tubs/a$"):
        from_tub(tmp_path / "tubs", tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("fields", "says"),
    [
        ({"user/angle": -8.0}, r"from -1 to 1, got 8; degrees are divided by those of full lock"),
        ({"user/angle": 1.02}, "from -1 to 1, got 1.02"),
        ({"user/throttle": 90.0}, "from -1 to 1, got 90"),
        ({"_timestamp_ms": 1_700_000_000.1}, r"_timestamp_ms 4 to 1000 ms apart, got 0 \(median"),
    ],
)
def test_a_tub_in_other_units_is_refused(fields: dict, says: str, tmp_path: Path) -> None:
    to_tub([recorded(tmp_path, "a")], tub := tmp_path / "tub")
    change(tub, fields)
    with pytest.raises(ConfigError, match=says):
        from_tub(tub, tmp_path / "out")
    assert not (tmp_path / "out").exists()
    change(tub, {"user/angle": 1.0005, "user/throttle": -1.0, "_timestamp_ms": 1.7e12})
    for number in range(30):
        change(tub, {"_timestamp_ms": 1.7e12 + 50.0 * number}, only=number)
    assert len(from_tub(tub, tmp_path / "out")) == 1, "as floats round"


@pytest.mark.parametrize("apart_ms", [0.0999, 1500.0])
def test_a_tub_whose_records_are_no_drive_is_refused(apart_ms: float, tmp_path: Path) -> None:
    to_tub([recorded(tmp_path, "a")], tub := tmp_path / "tub")
    for number in range(30):
        change(tub, {"_timestamp_ms": 1.7e12 + apart_ms * number}, only=number)
    with pytest.raises(
        ConfigError, match=r"_timestamp_ms 4 to 1000 ms apart, got (0\.0999|1\.5e\+03)"
    ):
        from_tub(tub, tmp_path / "out")


def test_drives_are_divided_whole(tmp_path: Path) -> None:
    drives = [recorded(tmp_path, name, 20 + 10 * i) for i, name in enumerate("abcdef")]
    for seed in range(4):
        parts = divide(drives, 0.3, seed)
        assert sorted(parts["learn"] + parts["held_out"]) == sorted(map(str, drives))
        seconds = {name: sum(tell(Path(p))["driven"] for p in parts[name]) for name in parts}
        assert seconds["held_out"] / sum(seconds.values()) == pytest.approx(0.3, abs=0.15)
    assert divide(drives, 0.3, 0) == divide(drives, 0.3, 0)
    with pytest.raises(ConfigError, match="two drives or more"):
        divide(drives[:1], 0.3, 0)


def test_the_commands(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    recorded(tmp_path / "own", "a")
    recorded(tmp_path / "own", "b")
    own = str(tmp_path / "own")
    assert main(["list", own]) == 0
    assert capsys.readouterr().out.splitlines()[1].split() == [
        "a",
        "daisy",
        "3",
        "s",
        "20",
        "10",
        "1",
        "0",
        "0",
    ]
    assert main(["plot", own, "--out", str(tmp_path / "plot.png")]) == 0
    assert (tmp_path / "plot.png").read_bytes().startswith(b"\x89PNG")
    assert main(["plot", own, "--out", str(tmp_path / "plot")]) == 0
    assert (tmp_path / "plot").read_bytes().startswith(b"\x89PNG"), "whatever its name"
    assert main(["split", own, "--out", str(tmp_path / "split.json")]) == 0
    one = f"{own}/a.mcap"
    began_s = next(read_samples(one)).time_s
    mark(Path(one), [Piece(began_s + 0.95, began_s + 1.95, "good")])
    assert main(["cut", one, "--out", str(tmp_path / "cut.mcap")]) == 0
    assert len(list(read_samples(tmp_path / "cut.mcap"))) == 10
    mark(Path(one), [])
    assert main(["to-donkeycar", own, "--out", str(tmp_path / "tub")]) == 0
    assert main(["to-donkeycar", own, "--out", str(tmp_path / "tub")]) == 2
    assert "expected a new folder" in capsys.readouterr().err
    assert main(["list", str(tmp_path / "nowhere.mcap")]) == 2
    assert main(["from-donkeycar", str(tmp_path / "tub"), "--out", str(tmp_path / "back")]) == 0


@pytest.mark.parametrize("after_s", [0.0, 0.1, 0.3])
def test_a_conversion_that_is_killed_leaves_nothing_and_the_next_completes_it(
    tmp_path: Path, after_s: float
) -> None:
    drive, tub = recorded(tmp_path / "own", "a", 300), tmp_path / "tub"
    words = ["-m", "tools.data", "to-donkeycar", str(drive), "--out", str(tub)]
    child = subprocess.Popen([sys.executable, *words])
    while not (tmp_path / ".tub.partial/images").exists():
        time.sleep(0.005)
    time.sleep(after_s)
    child.send_signal(signal.SIGKILL)
    child.wait()
    assert not tub.exists() or after_s > 0.0
    if not tub.exists():
        assert main(words[2:]) == 0
    assert len(list((tub / "images").iterdir())) == 300
    assert sorted(path.name for path in tmp_path.iterdir()) == ["own", "tub"]
    assert len(list(read_samples(drive))) == 300


HUNDRED = """
import random, sys
from pathlib import Path
from robot.recording.reader import Piece, mark
from tests.robot.recording.killed import kill_at
from tools.data.drives import to_tub
folder, rng = Path(sys.argv[1]), random.Random(0)
def work(number):
    if number % 2:
        to_tub([folder / "a.mcap"], folder / f"tub{number}")
    else:
        mark(folder / f"{number}.mcap", [Piece(1.0, 2.0, "bad")])
kill_at([rng.uniform(0.0, 0.5) for _ in range(100)], work)
"""


@pytest.mark.slow
def test_killed_at_a_hundred_moments_conversions_and_marks_lose_nothing(tmp_path: Path) -> None:
    drive = recorded(tmp_path, "a", 60)
    data = drive.read_bytes()
    for number in range(0, 100, 2):
        (tmp_path / f"{number}.mcap").write_bytes(data)
    subprocess.run([sys.executable, "-c", HUNDRED, str(tmp_path)], check=True)
    whole = list(read_samples(drive))
    done = 0
    for number in range(100):
        if number % 2 == 0:
            done += bool(read_pieces(tmp_path / f"{number}.mcap"))
            assert list(read_samples(tmp_path / f"{number}.mcap")) == whole
            continue
        tub = tmp_path / f"tub{number}"
        done += tub.exists()
        if not tub.exists():
            to_tub([drive], tub)
        assert len(list((tub / "images").iterdir())) == 60
        assert len((tub / "catalog_0.catalog").read_text().splitlines()) == 60
    assert 0 < done < 100, "some were killed before their end, some after"
    assert drive.read_bytes() == data
    assert not list(tmp_path.glob(".tub*"))


def test_a_folder_appears_only_when_it_is_whole(tmp_path: Path) -> None:
    def fails() -> None:
        with appearing(tmp_path / "out") as folder:
            (folder / "half").touch()
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fails()
    assert list(tmp_path.iterdir()) == []
