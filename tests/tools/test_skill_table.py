import json
from pathlib import Path

import pytest

from tools.skill_table import main
from trainer.presets import preset
from trainer.run import RunFolder


@pytest.fixture
def run(tmp_path: Path) -> Path:
    folder = RunFolder(tmp_path / "some_run")
    folder.go_on(preset("navigation", "dueling", "fast"))
    evaluations = [
        {"step": step, "seconds": step / 100, "cpu_seconds": step / 200, "success_rate": rate}
        for step, rate in ((1000, 0.5), (2000, 0.99), (3000, 0.9))
    ]
    metrics = {"train_steps": 3000, "train_seconds": 31.0, "evaluations": evaluations}
    folder.metrics.write_text(json.dumps(metrics))
    return folder.path


def test_the_first_good_evaluation_counts(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([str(run)]) == 0
    row = next(line for line in capsys.readouterr().out.splitlines() if "dueling" in line)
    cells = [cell.strip() for cell in row.strip("|").split("|")]
    assert cells[:7] == ["some_run", "navigation", "dueling", "0", "2,000", "20", "10"]
    assert cells[7].startswith("1.5 M")
    assert cells[8:] == ["3,000", "31", "-"]


def test_evaluations_in_the_folder_get_a_row(run: Path, tmp_path: Path) -> None:
    inputs = {"maps": ["a/town.yaml"], "look": "nominal", "pose_error": "arena", "zero": "image"}
    shares = {"episodes": 1000, "success_rate": 0.997, "success_rate_low": 0.991}
    drive = {"survival_time_s": 9.0, "driven_lane_m": 3.0, "outside_lane_s": 0.0}
    result = {"inputs": inputs, **shares, **drive, "mean_path_distance_m": 0.0123}
    (run / "held_out.json").write_text(json.dumps(result))
    page = tmp_path / "page.md"
    page.write_text("before\n<!-- nav -->\nold\n<!-- /nav -->\nafter\n")
    for _ in range(2):  # once more changes nothing
        assert main([str(run), "--into", str(page), "--block", "nav"]) == 0
        text = page.read_text()
        assert "| some_run | town | nominal | arena | image | 997 of 1000 | 99.1 % | 1.2 |" in text
        assert "old" not in text
        assert text.startswith("before\n")
        assert text.endswith("after\n")


def test_a_row_for_each_ring_and_way_round(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files = []
    for look, rows in (("nominal", (20, 19)), ("reality", (18, 20))):
        of = [
            {"map": "zed", "lane": lane, "episodes": 20, "succeeded": good}
            for lane, good in zip(("inner", "outer"), rows, strict=True)
        ]
        shares = {"episodes": 40, "success_rate": sum(rows) / 40}
        result = {"inputs": {"model": "a/keeper.onnx", "look": look}, **shares, "by_map": of}
        files.append(tmp_path / f"{look}.json")
        files[-1].write_text(json.dumps(result))
    assert main(["--by-map", *map(str, files)]) == 0
    text = capsys.readouterr().out
    assert "| map | lane | `keeper`, nominal | `keeper`, reality |" in text
    assert "| zed | inner | 20 of 20 | 18 of 20 |" in text
    assert "| all |  | **39 of 40** (97.5 %) | **38 of 40** (95.0 %) |" in text


def test_what_is_missing_is_said(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page = tmp_path / "page.md"
    page.write_text("no marks")
    assert main([str(run), "--into", str(page)]) == 2
    assert "<!-- tables -->" in capsys.readouterr().err
    assert main([str(tmp_path)]) == 2
