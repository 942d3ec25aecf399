"""The page says what there is."""

import base64
import json
import re
from dataclasses import replace
from html import unescape
from pathlib import Path

import pytest

from robot.errors import ConfigError
from robot.output import write_json
from robot.typed_config import to_plain
from tests.trainer.judging.test_rides import offered
from tests.trainer.test_run import episode
from trainer.cli import main
from trainer.judging.evaluate import DONE, Evaluation
from trainer.judging.films import film_worst, films_of, keep_films
from trainer.options import EvaluateOptions
from trainer.presets import preset
from trainer.report import page as module
from trainer.report.page import find_runs, read_runs, write_report
from trainer.run import EpisodeLog, RunFolder
from trainer.training.checkpoint import Evaluated, TrainState


def make_run(path: Path, algorithm: str = "ppo", seed: int = 0, task: str = "lane") -> RunFolder:
    folder = RunFolder(path)
    folder.go_on(replace(preset(task, algorithm, "debug"), seed=seed))
    log = EpisodeLog(folder)
    for step in range(16, 640, 16):
        log.add(episode(step))
    log.file.close()
    return folder


def judge(folder: RunFolder, failures: tuple[int, ...] = (), zero: str | None = None) -> Path:
    config = folder.load_config()
    maps, episodes = config.maps, 20
    inputs = EvaluateOptions(
        str(folder.onnx), config.task, maps, zero=zero, episodes=episodes, seed=7
    )
    share = 1.0 - len(failures) / episodes
    figures = (share, 0.5 * share, 0.02, 30.0, 9.0, 0.5)
    result = Evaluation(inputs, episodes, *figures, failures, config.algorithm, folder.path.name)
    path = folder.path / f"evaluation{zero or ''}.json"
    write_json(path, {**to_plain(result), "inputs": inputs.plain()})
    return path


def page_of(paths: list[Path], out: Path) -> str:
    return unescape(write_report(paths, out).read_text(encoding="utf-8"))


def test_what_there_is_not_is_not_shown(tmp_path: Path) -> None:
    make_run(tmp_path / "a")
    RunFolder(tmp_path / "new").go_on(preset("navigation", "dueling", "debug"))
    page = page_of([tmp_path], tmp_path / "out")
    assert "<details>" not in page
    assert {"films", "worst"}.isdisjoint(sections(page))
    assert page.count("<img") == 1, "of the run that has an episode"


def test_the_page_holds_every_picture_and_asks_for_nothing_else(tmp_path: Path) -> None:
    folder = make_run(tmp_path / "a", "dueling", task="navigation")
    path = judge(folder, failures=(8,))
    films = film_worst(offered([(DONE, 0.01), ("collided", 0.2)], 0, 2), tmp_path / "kept")
    ((_, film),) = keep_films(films, *films_of(path))
    folder.film.write_bytes(b"a film")
    (tmp_path / "drive.mp4").write_bytes(b"another")
    out = tmp_path / "out"
    page = page_of([tmp_path], out)
    inside = {base64.b64decode(data) for data in re.findall(r"base64,([A-Za-z0-9+/=]+)", page)}
    beside = {file.name: file.read_bytes() for file in out.glob("*.png")}
    assert set(beside) == {"curves_navigation.png"}
    assert inside == {*beside.values(), b"a film", b"another", film.read_bytes()}
    assert not re.search(r"(src|href)=\"(?!data:|#)", page)
    assert "96.4 % of 1000" in page
    assert "95.0 % (19 of 20" in page
    assert "Episode 1 on arena - collided" in page
    assert "The latest evaluation of a" in page
    assert sections(page)[0] == "films"
    assert "worst" in sections(page)


def sections(page: str) -> list[str]:
    return re.findall(r'<h2 id="(\w+)"', page)


def test_a_card_says_first_what_came_of_it(tmp_path: Path) -> None:
    page = page_of([make_run(tmp_path / "a").path], tmp_path / "out")
    assert "no evaluation yet" in cards(page)
    judge(make_run(tmp_path / "b", "dueling"), failures=(8,))
    page = page_of([tmp_path], tmp_path / "out")
    assert "<b>95.0 %</b>" in cards(page)
    assert "2.0 cm from the path on average" in cards(page)
    assert "not finished" in cards(page)


def cards(page: str) -> str:
    return page[page.index('class="cards"') : page.index("<h2")]


def test_the_papers_columns_stand_only_beside_figures_of_the_paper(tmp_path: Path) -> None:
    make_run(tmp_path / "coach", "coached", task="navigation")
    assert "paper A" not in page_of([tmp_path], tmp_path / "out")
    make_run(tmp_path / "ppo", "ppo", task="navigation")
    assert "paper A" in page_of([tmp_path], tmp_path / "out")


def test_an_ablation_has_its_row_but_nothing_of_the_papers(tmp_path: Path) -> None:
    folder = make_run(tmp_path / "a", "dueling", task="navigation")
    judge(folder)
    judge(folder, failures=(8, 9), zero="image")
    (run,) = read_runs([tmp_path], [])
    rows = {row.result.inputs.zero: row for row in run.judgements}
    assert rows[None].paper.driving == "96.4 % of 1000"
    assert rows["image"].paper.driving == "–"
    assert rows["image"].where == "arena · nominal · true pose · image zeroed"


def test_each_run_has_a_row_by_algorithm_and_seed(tmp_path: Path) -> None:
    for seed, failures in ((1, (7, 8, 9, 10)), (0, ())):
        judge(make_run(tmp_path / f"a{1 - seed}", "ppo", seed), failures)
    make_run(tmp_path / "z", "ddqn")
    found = [(run.config.algorithm, run.config.seed) for run in read_runs([tmp_path], [])]
    assert found == [("ddqn", 0), ("ppo", 0), ("ppo", 1)]
    shares = re.findall(
        r"(seed \d)</td><td>loop.*?ours\">([\d.]+ %)", page_of([tmp_path], tmp_path)
    )
    assert shares == [("seed 0", "100.0 %"), ("seed 1", "80.0 %")]


@pytest.mark.parametrize(
    ("shares", "told"),
    [
        ((0.5, 1.0, 0.0), ["200", "20", "–", "624", "100 %"]),
        ((0.9,), ["–", "–", "–", "624", "90 %"]),
        ((), ["–", "–", "–", "624", "–"]),
    ],
)
def test_learned_is_the_first_good_evaluation(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, shares: tuple[float, ...], told: list[str]
) -> None:
    evaluations = tuple(
        Evaluated(100 * (k + 1), 10.0 * (k + 1), share, 1.0, 1.0) for k, share in enumerate(shares)
    )
    folder = make_run(tmp_path / "a")
    folder.checkpoint.touch()
    monkeypatch.setattr(module, "read_state", lambda _: TrainState(evaluations=evaluations))
    page = page_of([tmp_path], tmp_path / "out")
    row = re.search(r"<tbody><tr>(.*?)</tr>", page)
    assert row is not None
    assert re.findall(r"<td.*?>(.*?)</td>", row[1])[-5:] == told


def test_a_broken_evaluation_is_told_and_the_rest_still_shown(tmp_path: Path) -> None:
    folder = make_run(tmp_path / "a")
    broken = json.loads(judge(folder).read_text())
    del broken["episodes"]
    write_json(folder.path / "old.json", broken)
    (folder.path / "half.json").write_text("{")
    other = json.loads(judge(folder).read_text())
    other["inputs"]["task"] = "parking"
    write_json(folder.path / "other.json", other)
    page = page_of([tmp_path], tmp_path / "out")
    assert "old.json: missing episodes" in page
    assert "other.json: task: " in page
    assert "parking" in page
    assert "half.json: expected figures in JSON" in page
    assert "100.0 % (20 of 20" in page


def test_a_folder_without_runs_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(ConfigError, match=r"no config\.yaml"):
        find_runs([tmp_path])
    assert main(["report", str(tmp_path / "none")]) == 2
    assert main(["report"]) == 2
    assert capsys.readouterr().err.count("\n") == 2
