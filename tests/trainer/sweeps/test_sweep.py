from dataclasses import dataclass
from pathlib import Path

import pytest
from rich.console import Console

from robot.errors import ConfigError, DuckpilotError
from robot.output import write_json
from tests.trainer.chores import Chore
from trainer.cli import main
from trainer.options import EvaluateOptions, SweepOptions, TrainOptions
from trainer.presets import preset
from trainer.run import RunFolder
from trainer.sweeps.jobs import TrainJob, combinations, evaluate_jobs
from trainer.sweeps.sweep import run_sweep


@dataclass(frozen=True)
class Dish:
    seed: int = 3
    sauce: str = "none"
    sides: tuple[str, ...] = ()
    too_hot: bool = False


def train_jobs(out: Path, options: TrainOptions, many: SweepOptions) -> list[TrainJob]:
    return [TrainJob(out / name, each, resume=True) for name, each in combinations(options, many)]


def matrix(path: Path, text: str) -> SweepOptions:
    (path / "matrix.yaml").write_text(text)
    return SweepOptions(matrix=path / "matrix.yaml")


def test_every_combination_once_with_its_name(tmp_path: Path) -> None:
    text = "sauce: [red, green]\nsides: [rice, [beans, corn bread]]\ntoo-hot: [true]"
    found = dict(combinations(Dish(), matrix(tmp_path, text)))
    assert found == {
        "sauce-red_sides-rice_too_hot-True": Dish(3, "red", ("rice",), True),
        "sauce-red_sides-beans+corn-bread_too_hot-True": Dish(
            3, "red", ("beans", "corn bread"), True
        ),
        "sauce-green_sides-rice_too_hot-True": Dish(3, "green", ("rice",), True),
        "sauce-green_sides-beans+corn-bread_too_hot-True": Dish(
            3, "green", ("beans", "corn bread"), True
        ),
    }


def test_seeds_count_from_the_given_one() -> None:
    found = combinations(Dish(), SweepOptions(seeds=3), seed_step=10)
    assert found == [("seed-3", Dish(3)), ("seed-13", Dish(13)), ("seed-23", Dish(23))]
    assert combinations(Dish(), SweepOptions(ray="auto")) == [("", Dish())]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("sause: [red]", "did you mean 'sauce'"),
        ("sauce: red", "sauce: expected a list of values, got 'red'"),
        ("sauce: []", "expected a list of values"),
        ("sauce: [1]", "sauce: expected str, got 1"),
        ("sauce: [a b, a-b]", "sauce-a-b twice"),
        ("[sauce]", "expected options with lists"),
    ],
)
def test_a_wrong_matrix_is_refused(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        combinations(Dish(), matrix(tmp_path, text))


def test_seeds_are_given_once(tmp_path: Path) -> None:
    many = SweepOptions(seeds=2, matrix=matrix(tmp_path, "seed: [1, 2]").matrix)
    with pytest.raises(ConfigError, match="no seed in the matrix"):
        combinations(Dish(), many)
    with pytest.raises(ConfigError, match="1 or more"):
        combinations(Dish(), SweepOptions(seeds=0))


def test_evaluations_lie_beside_their_models_and_share_no_episode(tmp_path: Path) -> None:
    many = matrix(tmp_path, "model: [a/model.onnx, b/model.onnx]\nzero: [null, image]")
    jobs = evaluate_jobs(tmp_path / "e.json", EvaluateOptions(episodes=7), False, many)
    assert [job.out.name for job in jobs][:2] == [
        "e_model-a-model.onnx_zero-None.json",
        "e_model-a-model.onnx_zero-image.json",
    ]
    beside = evaluate_jobs(None, EvaluateOptions("a/model.onnx"), True, SweepOptions(seeds=2))
    assert [str(job.out) for job in beside] == [
        "a/evaluation_seed-1000.json",
        "a/evaluation_seed-1100.json",
    ]


def test_a_wrong_name_in_the_matrix_is_found_before_anything_begins(tmp_path: Path) -> None:
    path = matrix(tmp_path, "algo: [ppo, dualing]").matrix
    assert main(["train", "--out", str(tmp_path / "out"), "--matrix", str(path)]) == 2
    assert not (tmp_path / "out").exists()
    path = matrix(tmp_path, "map: [loop, lop]").matrix
    assert main(["train", "--out", str(tmp_path / "out"), "--matrix", str(path)]) == 2
    assert not (tmp_path / "out").exists()


def test_a_finished_run_is_skipped_and_another_one_refused(tmp_path: Path) -> None:
    options = TrainOptions(preset="debug", algo="ppo")
    (job,) = train_jobs(tmp_path, options, SweepOptions(seeds=1))
    assert not job.finished()
    folder = RunFolder(tmp_path / "seed-0")
    folder.go_on(preset("lane", "ppo", "debug"))
    assert not job.finished()
    write_json(folder.metrics, {"stopped_by": "steps", "train_steps": 512, "train_seconds": 1.0})
    assert job.finished()
    (longer,) = train_jobs(tmp_path, TrainOptions(preset="debug", algo="ppo", steps=600), _ONE)
    assert not longer.finished()
    (other,) = train_jobs(tmp_path, TrainOptions(preset="debug", algo="a2c"), _ONE)
    with pytest.raises(ConfigError, match="choose another --out"):
        other.finished()


_ONE = SweepOptions(seeds=1)


def test_failures_are_told_at_the_end_and_the_rest_is_done(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    ways = ("write", "refuse", "crash", "die", "fail", "write")
    jobs = [Chore(tmp_path / f"{k}-{does}", does) for k, does in enumerate(ways)]
    (tmp_path / "5-write").write_text("before")
    assert run_sweep(jobs, SweepOptions(workers=2), Console(width=200)) == 1
    out = capsys.readouterr().out
    assert "5-write: finished before" in out
    assert "1-refuse: failed, expected this, got that" in out
    assert "2-crash: failed, RuntimeError: a bug" in out
    assert "3-die: failed, killed by SIGKILL" in out
    assert "4-fail: failed, 4-fail speaks past Python" in out
    assert "1 of 5 done" in out
    assert (tmp_path / "0-write").read_text() == "write 1"
    assert (tmp_path / "5-write").read_text() == "before"
    again = [job for job in jobs if job.does == "write"]
    assert run_sweep(again, SweepOptions(workers=1), Console(width=200)) == 0


def test_what_cannot_be_done_keeps_everything_from_beginning(tmp_path: Path) -> None:
    jobs = [Chore(tmp_path / "a"), Chore(tmp_path / "b", "impossible")]
    with pytest.raises(DuckpilotError):
        run_sweep(jobs, SweepOptions(workers=2), Console(quiet=True))
    assert not list(tmp_path.iterdir())
