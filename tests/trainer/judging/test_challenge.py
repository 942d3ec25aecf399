"""The judge of the AI Driving Olympics' challenges: its figures, how sure they are, its command."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from robot.inference.policy import SHIPPED_MODELS
from trainer.cli import main
from trainer.judging import blocks
from trainer.judging.challenge import Episode
from trainer.judging.intervals import median, paired, share
from trainer.judging.olympics import LaneFigures, Verdict, longest_wait_s

RACER = str(SHIPPED_MODELS / "track_ppo.onnx")


def test_shares_have_wilsons_interval() -> None:
    found = share(81, 263)
    assert tuple(found) == pytest.approx((0.308, 0.255, 0.366), abs=5e-4)  # Newcombe 1998, table I
    assert share(0, 20).low == 0.0
    assert share(20, 20).high == 1.0


def test_a_median_lies_in_its_interval_which_holds_the_truth_nine_times_of_ten() -> None:
    rng, held = np.random.default_rng(3), 0
    for _ in range(100):
        found = median(rng.exponential(1.0, 60).tolist())
        assert found.low <= found.value <= found.high
        held += found.low <= np.log(2.0) <= found.high
    assert held >= 88
    assert tuple(median([2.0] * 9)) == (2.0, 2.0, 2.0)
    # Medians of draws are the third of 13 or less in 1.6 %, the fourth or less in 7.1 %.
    assert tuple(median(list(range(13)))) == (6.0, 3.0, 9.0)


@pytest.mark.parametrize(
    ("only_first", "only_second", "p_value"),
    [(0, 0, 1.0), (6, 0, 0.03125), (0, 6, 0.03125), (9, 1, 0.021484375), (5, 5, 1.0)],
)
def test_mcnemars_exact_test_by_hand(only_first: int, only_second: int, p_value: float) -> None:
    first = [True] * 7 + [True] * only_first + [False] * only_second
    second = [True] * 7 + [False] * only_first + [True] * only_second
    assert tuple(paired(first, second).values()) == (
        only_first,
        only_second,
        pytest.approx(p_value),
    )


def episode(seed: int, end: str, tiles: float, at_fault: bool = False, runs: int = 0) -> Episode:
    success = end == "time" and tiles >= 3.0
    lane = "loop", runs, tiles, LaneFigures(*[tiles] * 6)
    return Episode(seed, 0, end, at_fault, success, 0.25 * seed, float(seed), *lane)


def test_a_verdict_takes_medians_and_counts_what_went_wrong_and_by_whose_fault() -> None:
    verdict = Verdict(
        "x",
        [
            episode(0, "time", 6.0, runs=2),
            episode(1, "time", 5.0),
            episode(2, "collision_duck", 2.0, at_fault=True),
            episode(3, "collision_robot", 1.0),
            episode(4, "out_of_tile", 0.0),
        ],
    )
    told = verdict.plain()
    assert (told["collision_free_rate"], told["success_rate"]) == (0.8, 0.4)
    assert told["tiles"] == told["deviation-center-line"] == 2.0
    assert told["half_second_kept_rate"] == 0.6  # of 0, 0.25, 0.5, 0.75 and 1 s
    assert (told["longest_wait"], told["longest_wait_of_all"]) == (2.0, 4.0)
    assert told["infractions"] == {
        "collision_duck": 1,
        "collision_robot_by_others": 1,
        "line_run": 2,
        "out_of_tile": 1,
    }


def test_intervals_are_told_from_low_to_high() -> None:
    told = Verdict("x", [episode(k, "time", 3.0 + k) for k in range(9)]).plain()["intervals"]
    assert told["success_rate"] == pytest.approx([0.701, 1.0], abs=1e-3)  # Wilson, of 9 in 9
    assert told["tiles"] == [4.0, 10.0]  # medians of draws are the least of nine once in 700 times


def test_worst_is_who_failed_after_the_fewest_tiles() -> None:
    ends = [("time", 9.0), ("collision_duck", 2.0), ("time", 2.9), ("out_of_tile", 0.5)]
    drives = [episode(k, *end) for k, end in enumerate([*ends, ("time", 4.0)])]
    worst_first = sorted(drives, key=lambda drive: drive.badness, reverse=True)
    assert [drive.tiles for drive in worst_first] == [0.5, 2.0, 2.9, 4.0, 9.0]


@pytest.mark.parametrize(
    ("way", "wait_s"),
    [
        ("", 0.0),
        (">>>>>>>>>", 0.0),
        (".........", 0.9),
        (">>>>>>>..>>>>>>", 0.2),
        ("...>>>>>..>>>>>", 0.3),
        ("..>>>>>>>>.....", 0.5),
        (">>~~~>>", 0.0),
    ],
)
def test_the_longest_wait_is_at_rest_below_two_centimetres_a_second(
    way: str, wait_s: float
) -> None:
    steps_m = [{">": 0.03, ".": 0.0019, "~": 0.0021}[step] for step in way]
    x_m = np.concatenate(([0.0], np.cumsum(steps_m)))
    poses = np.stack((x_m, 0.0 * x_m, 0.0 * x_m), axis=1)
    assert longest_wait_s(poses, 0.1) == pytest.approx(wait_s)


def test_who_stands_has_no_collision_and_no_success() -> None:
    drives = Verdict("x", [episode(k, "time", 9.0) for k in range(6)])
    stands = Verdict("y", [episode(k, "time", 0.0) for k in range(6)])
    assert stands.plain()["collision_free_rate"] == 1.0
    found = drives.against(stands)
    assert (found["only_first"], found["only_second"], found["p_value"]) == (6, 0, 0.03125)


def test_the_command_says_the_same_again_and_shows_the_worst(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(blocks, "ROBOTS", 1)
    asked = ["judge", "--model", "expert", "--against", "stand", "--episodes", "2"]
    asked += ["--seconds", "3"]
    files = [tmp_path / f"{k}.json" for k in (1, 2)]
    for workers, file in enumerate(files, start=1):
        out = ["--out", str(tmp_path / "out"), "--workers", str(workers)]
        assert main([*asked, "--map", "loop", "--json", str(file), *out]) == 0
    assert files[0].read_bytes() == files[1].read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["1.json", "2.json", "out"]
    told = json.loads(files[0].read_text())
    assert (told["challenge"], told["episodes"], told["collision_free_rate"]) == ("lf", 2, 1.0)
    assert told["tiles"] > 1.0
    assert (told["longest_wait"], told["against"]["longest_wait"]) == (0.0, pytest.approx(3.0))
    assert told["against"]["tiles"] == pytest.approx(0.0, abs=1e-9)
    assert told["survival_time"] == told["against"]["survival_time"] == pytest.approx(3.0)
    assert told["driven_lanedir_consec"] == pytest.approx(0.585 * told["tiles"])
    assert {"deviation-center-line", "in-drivable-lane", "deviation-heading"} <= told.keys()
    page = (tmp_path / "out" / "judge.html").read_text()
    assert page.count("<video") == 2
    assert "Episode 1000 on loop" in page


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--model", "none.onnx"], "none.onnx: expected a policy, .onnx, expert or stand"),
        (["--model", "stand", "--map", "nowhere"], "nowhere: expected a map file"),
        (["--model", "bare"], "bare: expected a policy, .onnx, expert or stand"),
        (["--model", "stand", "--challenge", "lfx"], "lfx"),
        (["--model", "stand", "--episodes", "0"], "episodes: expected"),
        (["--model", "stand", "--seconds", "nan"], "seconds: expected"),
        (["--model", RACER], "expected a policy for lane, got one for track"),
        (["--model", "stand", "--workers", "0"], "workers: expected 1 to"),
    ],
)
def test_wrong_words_are_one_line_and_status_2(
    words: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    try:
        status = main(["judge", *words])
    except SystemExit as ended:
        status = int(ended.code or 0)
    assert status == 2
    told = capsys.readouterr().err.strip()
    assert said in told
    assert "\n" not in told
