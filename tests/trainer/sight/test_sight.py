import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import torch
from rich.console import Console

from robot.errors import ConfigError, ContractError
from robot.geometry import bezier_points
from robot.navigation.lane_view import KINDS, LaneView
from robot.navigation.road_map import load_map
from robot.vision.sight import COLUMNS, OnnxSight, Seen, SightContract, as_seen
from sim_pybullet.look import NOMINAL
from sim_pybullet.tasks.navigation import Navigation
from tests.trainer import judge_sight
from trainer.cli import main
from trainer.division import division
from trainer.sight.cli import SHIPPED, SightRun
from trainer.sight.draw import drawn
from trainer.sight.network import SightNetwork, calibrate, export_sight, learned
from trainer.sight.pictures import (
    CROSSING,
    DRIVEN_M,
    FIGURES,
    IMAGE,
    KIND,
    LINE,
    NEW,
    ROAD,
    ROBOTS,
    START_SPREAD,
    THING,
    Pictures,
    anywhere,
    drive,
    label,
)
from trainer.sight.train import Batches, lesson

TOWN = load_map("town")


@pytest.fixture(scope="module")
def driven() -> Pictures:
    return drive(Navigation([TOWN], ROBOTS, START_SPREAD), [NOMINAL], 3, 40)


@pytest.fixture(scope="module")
def elsewhere() -> Pictures:
    return anywhere([TOWN], [NOMINAL], 3)


@pytest.fixture(scope="module")
def untaught(tmp_path_factory: pytest.TempPathFactory, driven: Pictures) -> Path:
    path = tmp_path_factory.mktemp("sight") / "sight.onnx"
    torch.manual_seed(0)
    network = SightNetwork().eval()
    export_sight(network, SightContract(IMAGE, run="none"), driven.images[:8], path)
    return path


def test_labels_are_those_of_the_map_where_the_picture_was_taken(driven: Pictures) -> None:
    labels = driven.labels
    assert driven.images.shape == (40 * ROBOTS, 40, 80, 3)
    assert (labels[:, NEW] == 1.0).all(), "no picture of this look comes twice"
    assert 0.05 < labels[:, DRIVEN_M].sum() / ROBOTS < 0.03 * 40 * 1.1
    lane = (labels[:, CROSSING] == 0.0) & (labels[:, ROAD] == 1.0)
    assert labels[lane, 0].min() >= -0.14
    assert labels[lane, 0].max() <= 0.3
    lined = labels[:, LINE] == 1.0
    assert ((labels[lined, 3] >= 0.12) & (labels[lined, 3] <= 0.45)).all()
    assert (labels[lined, KIND] >= 1.0).all()
    assert np.isnan(labels[labels[:, LINE] == 0.0, 3]).all()


def test_the_same_seed_gives_the_same_pictures(driven: Pictures) -> None:
    again = drive(Navigation([TOWN], ROBOTS, START_SPREAD), [NOMINAL], 3, 5)
    np.testing.assert_array_equal(again.images, driven.images[: 5 * ROBOTS])


def test_who_looks_against_the_traffic_sees_the_oncoming_lane_and_beside_the_road_none() -> None:
    lane = TOWN.lanes[0].control_points_m
    x, y = lane[0].tolist()
    heading = float(np.arctan2(*(lane[1] - lane[0])[::-1]))
    view = LaneView(TOWN)
    assert label(view, (x, y, heading))[ROAD] == 1.0
    turned = label(view, (x, y, heading + np.pi))
    assert turned[[0, ROAD]].tolist() == pytest.approx([0.234, 1.0], abs=1e-3)
    assert label(view, (-1.0, -1.0, 0.0))[ROAD] == 0.0


def test_who_is_in_the_oncoming_lane_is_told_how_far_and_nothing_of_its_own_lane() -> None:
    control, view = TOWN.lanes[0].control_points_m, LaneView(TOWN)
    ahead = (control[3] - control[0]) / np.hypot(*(control[3] - control[0]))
    middle, left = bezier_points(control, np.array((0.5,)))[0], np.array((-ahead[1], ahead[0]))
    heading_rad = float(np.arctan2(ahead[1], ahead[0]))
    for offset_m, road in ((0.0, 1.0), (0.23, 1.0), (0.32, -1.0), (0.37, 0.0), (-0.16, -1.0)):
        found = label(view, (*(middle + offset_m * left).tolist(), heading_rad))
        assert found[ROAD] == road, offset_m
        if road == 1.0:
            assert found[0] == pytest.approx(offset_m, abs=1e-3)
        if offset_m == 0.23:
            assert np.isnan(found[3:FIGURES]).all()
            assert (found[[LINE, THING, KIND]] == -1.0).all()


def test_some_pictures_from_anywhere_show_no_road(elsewhere: Pictures) -> None:
    assert (elsewhere.labels[:, ROAD] == 0.0).sum() >= 4


def test_an_answer_that_nobody_knows_teaches_nothing() -> None:
    torch.manual_seed(0)
    network = SightNetwork()
    images = torch.randint(0, 256, (4, *IMAGE.shape), dtype=torch.uint8)
    labels = torch.full((4, 12), float("nan"))
    labels[:, FIGURES:] = -1.0
    assert float(network.loss(images, labels).detach()) == 0.0


def test_it_learns_and_its_uncertainty_is_scaled_to_its_errors(driven: Pictures) -> None:
    torch.manual_seed(0)
    network = SightNetwork()
    optimiser = torch.optim.AdamW(network.parameters(), 1e-3)
    torch.set_num_threads(1)
    step = lesson(network, optimiser, Batches(driven, None, SightRun(steps=50, batch=24)))
    told = [float(step(np.random.default_rng(k), k).split()[-1]) for k in range(50)]
    assert np.mean(told[-10:]) < np.mean(told[:10]) - 1.0
    calibrate(network, driven)
    seen = as_seen(network.see(driven.images))
    ratio = (seen.figures - driven.labels[:, :FIGURES]) / seen.deviations
    ratio[driven.labels[:, LINE] != 1.0, 3] = np.nan
    np.testing.assert_allclose(np.sqrt(np.nanmean(ratio[:, :4] ** 2, axis=0)), 1.0, atol=0.02)


@pytest.mark.parametrize("cores", [1, 3])
def test_batches_follow_from_seed_and_step_whoever_makes_them(
    cores: int, driven: Pictures, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("os.sched_getaffinity", lambda _: range(cores))
    batches = Batches(driven, driven, SightRun(steps=7, batch=17, seed=5))
    made = list(batches.since(3))
    assert len(made) == 4
    for step, (images, labels) in zip(range(3, 7), made, strict=True):
        wanted = batches[step]
        assert torch.equal(images, wanted[0])
        np.testing.assert_array_equal(labels.numpy(), wanted[1].numpy())
        assert images.shape == (17, *IMAGE.shape)
    assert not torch.equal(made[0][0], made[1][0])
    other = Batches(driven, driven, SightRun(steps=7, batch=17, seed=6))
    assert not torch.equal(other[3][0], made[0][0])


def test_the_file_holds_its_contract_and_answers_in_columns(untaught: Path) -> None:
    sight = OnnxSight(untaught)
    assert (sight.contract.image, sight.contract.run) == (IMAGE, "none")
    seen = sight(np.zeros((3, *IMAGE.shape), np.uint8))
    assert seen.figures.shape == seen.deviations.shape == (3, FIGURES)
    assert (seen.deviations > 0.0).all()
    np.testing.assert_allclose(seen.junction.sum(axis=1), 1.0, rtol=1e-5)
    assert len(COLUMNS) == 2 * FIGURES + 3 + len(KINDS)
    with pytest.raises(ContractError, match="expected"):
        sight(np.zeros((1, 60, 80, 3), np.uint8))


def test_who_learns_on_begins_with_what_the_file_sees(driven: Pictures) -> None:
    network, there = learned(SHIPPED), OnnxSight(SHIPPED)(driven.images[:8])
    network.eval()  # in training it sees in bfloat16, where the processor has it
    found = as_seen(network.see(driven.images[:8]))
    np.testing.assert_allclose(found.figures, there.figures, atol=1e-3)
    np.testing.assert_allclose(found.road, there.road, atol=1e-3)
    assert all(part.requires_grad for part in network.parameters())


def test_a_policy_is_no_sight() -> None:
    with pytest.raises(ContractError, match="train-sight"):
        OnnxSight(SHIPPED.with_name("lane_ppo.onnx"))


def test_a_judgement_of_the_map_itself_is_perfect(
    driven: Pictures, elsewhere: Pictures, untaught: Path
) -> None:
    class Knowing(OnnxSight):
        def __call__(self, pictures: np.ndarray):  # type: ignore[no-untyped-def]
            seen = super().__call__(pictures)
            return seen._replace(line=np.zeros(len(pictures)))

    found = judge_sight.judge(Knowing(untaught), "nominal", driven, elsewhere, driven)
    assert found.line_found == 0.0
    assert found.lines_passed_by == found.lines > 0
    assert found.invented_per_200_m == 0.0
    assert found.driven_m == pytest.approx(float(driven.labels[:, DRIVEN_M].sum()), rel=1e-3)


def test_a_run_that_was_cut_off_goes_on_and_another_is_refused(tmp_path: Path) -> None:
    from trainer.sight import train

    run = SightRun(files=1, steps=4, batch=8, look=("nominal",), choosing_files=1)
    out, small = tmp_path / "run", pytest.MonkeyPatch()
    small.setattr(train, "DECISIONS", 3)
    maps = replace(division().maps, training=("loop",), choosing=("rings/claw",))
    small.setattr(train, "division", lambda: replace(division(), maps=maps))
    try:
        path = train.train_sight(out, run, Console(quiet=True))
        kept = (out / "training" / "000.npz").stat().st_mtime_ns
        first = path.read_bytes()
        path.unlink()
        assert train.train_sight(out, run, Console(quiet=True)).read_bytes() == first
        assert (out / "training" / "000.npz").stat().st_mtime_ns == kept
        further = replace(run, base=str(path), steps=1)
        onward = train.train_sight(tmp_path / "onward", further, Console(quiet=True))
        assert OnnxSight(onward).contract.trained_steps == 5
        began, left = (learned(each).head.weight for each in (path, onward))
        assert 0.0 < float((began - left).detach().abs().max()) < 0.01, "it goes on from there"
        with pytest.raises(ConfigError, match="another --out"):
            train.train_sight(out, SightRun(steps=5), Console(quiet=True))
    finally:
        small.undo()
    assert (out / "sight_int8.onnx").exists()


def test_wrong_input_is_refused_before_a_run_begins(tmp_path: Path) -> None:
    wrong = [
        ["--base", str(tmp_path / "none.onnx")],
        ["--base", str(SHIPPED.with_name("lane_ppo.onnx"))],
        ["--photographs", str(tmp_path)],
    ]
    for words in wrong:
        assert main(["train-sight", "--out", str(tmp_path / "run"), *words]) == 2
        assert not (tmp_path / "run").exists(), "the right words would be another run's"


def test_sight_never_learns_in_looks_that_it_is_judged_in(tmp_path: Path) -> None:
    words = ["train-sight", "--out", str(tmp_path / "run"), "--look", "reality"]
    assert main(words) == 2
    assert not (tmp_path / "run").exists()


@pytest.fixture
def photograph(tmp_path: Path) -> Path:
    path = tmp_path / "one.png"
    cv2.imwrite(str(path), np.full((120, 160, 3), 90, np.uint8))
    return path


def test_what_is_seen_is_drawn_over_a_picture(untaught: Path, photograph: Path) -> None:
    out = photograph.parent / "seen"
    assert main(["sight", str(photograph), "--out", str(out), "--model", str(untaught)]) == 0
    drawn_picture = cv2.imread(str(out / "one_seen.png"))
    assert drawn_picture.shape == (360, 480, 3)
    assert (drawn_picture != 90).any()


def test_judging_writes_its_figures(untaught: Path, tmp_path: Path) -> None:
    path = tmp_path / "sight.json"
    words = ["--model", str(untaught), "--json", str(path), "--look", "nominal"]
    assert judge_sight.main([*words, "--map", "town", "--decisions", "5"]) == 0
    found = json.loads(path.read_text())
    assert found["inputs"]["maps"] == ["town"]
    assert found["looks"][0]["offset_m"]["pictures"] > 0


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("heading_rad", np.linspace(-np.pi, np.pi, 13))
@pytest.mark.parametrize("curvature_pm", [-8.0, 0.0, 8.0])
def test_a_lane_beside_or_behind_the_picture_is_no_trouble(
    heading_rad: float, curvature_pm: float
) -> None:
    figures = np.array([[0.1, heading_rad, curvature_pm, 0.3, 0.3]])
    said = np.ones(1), np.ones(1), np.full((1, len(KINDS)), 0.2), np.ones(1)
    seen = Seen(figures, 0.1 * np.ones((1, 5)), *said)
    assert drawn(np.full((120, 160, 3), 90, np.uint8), seen, NOMINAL.rig()).shape == (360, 480, 3)


@pytest.mark.parametrize("at", range(len(KINDS)))
def test_all_words_about_a_picture_lie_within_it(at: int, monkeypatch: pytest.MonkeyPatch) -> None:
    written: list[tuple[str, int]] = []

    def put(_: np.ndarray, text: str, corner: tuple[int, int], font: int, *how: Any) -> None:
        (width_px, _), _ = cv2.getTextSize(text, font, how[0], how[2])
        written.append((text, corner[0] + width_px))

    monkeypatch.setattr(cv2, "putText", put)
    figures = np.array([[-0.188, -1.745, -8.8, 0.388, 0.388]])
    likely = np.eye(len(KINDS))[[at]]
    said = np.ones(1), np.ones(1), likely, np.ones(1)
    seen = Seen(figures, np.array([[0.188, 1.745, 8.8, 0.288, 0.288]]), *said)
    drawn(np.full((120, 160, 3), 90, np.uint8), seen, NOMINAL.rig())
    assert "way 39 +-29 cm" in " ".join(text for text, _ in written)
    assert max(end_px for _, end_px in written) < 480
