"""Unusual input of transfer, experiments, judging and reports: told, and nothing is left."""

import json
import os
from dataclasses import replace
from hashlib import sha256
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml
from rich.console import Console

from robot.errors import ConfigError
from robot.navigation.road_map import shipped_maps
from robot.output import write_yaml
from tests.trainer.experiments.test_table1 import write_drive
from trainer.cli import main
from trainer.experiments.cli import Figure5Options
from trainer.experiments.figure5 import translator
from trainer.experiments.records import load_drive
from trainer.judging.explain import Explainer
from trainer.options import EvaluateOptions
from trainer.presets import preset
from trainer.report.curves import draw_panels
from trainer.report.page import read_runs
from trainer.run import RunFolder
from trainer.sweeps.jobs import EvaluateJob
from trainer.transfer.cli import Source
from trainer.transfer.labelled import load_annotations
from trainer.transfer.pictures import load_pictures

MODELS = Path(__file__).parents[2] / "robot" / "models"


@pytest.fixture(scope="module")
def sim(tmp_path_factory: pytest.TempPathFactory) -> Path:
    from trainer.transfer.pictures import collect

    out = tmp_path_factory.mktemp("sim") / "frames"
    collect(out, Source(("loop",), 6, "nominal", seed=3))
    return out


def write_pictures(folder: Path, count: int = 3) -> Path:
    folder.mkdir()
    for k in range(count):
        cv2.imwrite(str(folder / f"{k}.png"), np.full((60, 80, 3), 40 * k, np.uint8))
    return folder


def two_maps(folder: Path) -> list[str]:
    found = []
    for name in ("loop", "judging/rings/anvil"):
        file = folder / Path(name).name / "ring.yaml"
        file.parent.mkdir()
        file.write_bytes(shipped_maps()[name].read_bytes())
        found.append(str(file))
    return found


@pytest.mark.parametrize("command", ["judge", "evaluate"])
def test_maps_of_one_name_are_refused(
    command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    model = ["--model", str(MODELS / "lane_ppo.onnx"), "--episodes", "2", "--workers", "1"]
    short = ["--seconds", "1"] if command == "judge" else []
    assert main([command, *model, *short, "--map", *two_maps(tmp_path)]) == 2
    assert "different names, got two ring" in capsys.readouterr().err


def test_a_policy_of_stacked_pictures_is_explained() -> None:
    explainer = Explainer(MODELS / "track_ppo.onnx")
    assert explainer.contract.frames > 1
    picture = np.random.default_rng(0).integers(
        0, 256, explainer.contract.image.shape, dtype=np.uint8
    )
    assert explainer.attention(picture[None])[0].max() > 0.9
    assert explainer.influence(picture).max() == pytest.approx(1.0)


def test_networks_of_another_drive_are_not_taken(tmp_path: Path) -> None:
    command = ["experiment", "paper-b-accuracy", "--seeds", "1", "--steps", "20"]
    told = []
    for name, outs in (("first", ["shared"]), ("other", ["shared", "own"])):
        (tmp_path / name).mkdir()
        write_drive(tmp_path / name, 150 if name == "first" else 160)
        for out in outs:
            where = ["--data", str(tmp_path / name), "--out", str(tmp_path / out)]
            assert main([*command, *where, "--rate-hz", "10"]) == 0
            told.append(json.loads((tmp_path / out / "table1.json").read_text()))
    assert told[1] == told[2]
    assert len(list((tmp_path / "shared").glob("supervised_*.pt"))) == 2


def test_a_translator_of_other_options_is_not_taken(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def gather(out: Path, source: Source) -> None:
        write_yaml(out / "collection.yaml", source)

    def learn(out: Path, *_: object) -> Path:
        (out / "sim_to_real.onnx").touch()
        return out / "sim_to_real.onnx"

    monkeypatch.setattr("trainer.transfer.pictures.collect", gather)
    monkeypatch.setattr("trainer.transfer.pix2pix.translate_through", learn)
    options, console = Figure5Options(frames=4), Console(quiet=True)
    made = translator(tmp_path, options, console)
    assert translator(tmp_path, replace(options, seeds=9, steps=9), console) == made
    for other in (
        replace(options, frames=5),
        replace(options, translator_steps=2),
        replace(options, look="tracks/dusk"),
        replace(options, preset="debug"),
    ):
        with pytest.raises(ConfigError, match="expected what is asked for, got another"):
            translator(tmp_path, other, console)


def test_an_evaluation_of_a_policy_that_has_learned_on_is_not_finished(tmp_path: Path) -> None:
    model, out = tmp_path / "model.onnx", tmp_path / "evaluation.json"
    model.write_bytes((MODELS / "lane_ppo.onnx").read_bytes())
    asked = EvaluateOptions(model=str(model), task="lane")
    told: Any = {"inputs": asked.filled_in("lane").plain()}
    job = EvaluateJob(out, asked, drives=False)
    for known in ({}, {"model_sha256": sha256(model.read_bytes()).hexdigest()}):  # once not told
        out.write_text(json.dumps({**told, **known}))
        os.utime(model, (4e9, 4e9))  # as copies have
        assert job.finished()
    model.write_bytes((MODELS / "lane_dueling.onnx").read_bytes())
    os.utime(model, (1e9, 1e9))
    assert not job.finished()


def test_a_report_leaves_out_runs_of_translators_and_tells_of_damage(tmp_path: Path) -> None:
    folder = RunFolder(tmp_path / "lane")
    folder.go_on(preset("lane", "dueling", "debug"))
    (tmp_path / "road").mkdir()
    (tmp_path / "road" / "config.yaml").write_text("labels: road\nsteps: 2\n")
    (folder.path / "x.json").write_text('{"inputs": [1], "success_rate": 1}')
    assert [run.folder.path for run in read_runs([tmp_path], [])] == [folder.path]
    with pytest.raises(ConfigError, match="expected the configuration of a training"):
        read_runs([tmp_path / "road"], [])
    folder.progress.write_text("step,seconds,robot,reward,length,success\n12,x,0,1,5,1\n")
    with pytest.raises(ConfigError, match=r"progress.csv: expected numbers"):
        read_runs([tmp_path], [])


def test_a_title_may_have_dollars(tmp_path: Path) -> None:
    draw_panels([("a $b$ c$_$ d", [([], [])])], tmp_path / "p.png")
    assert (tmp_path / "p.png").exists()


def test_a_video_without_pictures_is_refused(tmp_path: Path) -> None:
    from robot.contract import ImageSpec

    file = tmp_path / "none.avi"
    cv2.VideoWriter(str(file), cv2.VideoWriter_fourcc(*"MJPG"), 10, (64, 48)).release()
    with pytest.raises(ConfigError, match=r"none\.avi: expected"):
        load_pictures([file], ImageSpec())


def test_wrong_input_of_a_training_leaves_no_run(sim: Path, tmp_path: Path) -> None:
    pictures, out = write_pictures(tmp_path / "pictures"), tmp_path / "out"
    for command in (
        ["translate", "train", "--sim", str(pictures), "--real", str(pictures)],
        ["parse", "translate", "--sim", str(pictures), "--real", str(sim)],
        ["parse", "translate", "--sim", str(sim), "--real", str(pictures), "--parser", str(out)],
        ["parse", "train", "--pairs", str(sim), "--size", "8", "8"],
    ):
        assert main([*command, "--steps", "1", "--out", str(out)]) == 2
        assert not out.exists()


def test_a_parser_is_exported_into_a_new_folder(sim: Path, tmp_path: Path) -> None:
    command = ["parse", "train", "--pairs", str(sim), "--size", "16", "16", "--steps", "1"]
    assert main([*command, "--batch", "1", "--out", str(tmp_path / "run")]) == 0
    file = tmp_path / "new" / "folder" / "parser.onnx"
    model = str(tmp_path / "run" / "parser.pt")
    assert main(["parse", "export", "--model", model, "--out", str(file)]) == 0
    assert file.exists()


@pytest.mark.parametrize(
    "options",
    [
        ["six-models", "--look", "nowhere"],
        ["six-models", "--test-map", "nowhere"],
        ["paper-b-transfer", "--looks", "nowhere"],
        ["paper-b-transfer", "--test-look", "nowhere"],
        ["paper-b-transfer", "--algo", "nobody"],
    ],
)
def test_an_experiment_finds_what_is_wrong_before_it_begins(
    options: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from trainer.experiments import cli

    out = tmp_path / "out"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(cli, "run_sweep", lambda *_: pytest.fail("began"))
        patch.setattr(
            "trainer.transfer.pictures.collect", lambda *_: pytest.fail("gathered frames")
        )
        assert main(["experiment", *options, "--preset", "debug", "--out", str(out)]) == 2
    assert options[-1] in capsys.readouterr().err
    assert not out.exists()


SQUARE = [[0, 0], [9, 0], [9, 9]]


@pytest.mark.parametrize(
    ("size", "shapes"),
    [
        ([160, 120], None),
        ([160, 120], [{"kind": "road", "points": []}]),
        ([160, 120], [{"kind": "road", "points": SQUARE, "width": 1e9}]),
        ([0, 0], [{"kind": "road", "points": SQUARE}]),
    ],
)
def test_annotations_that_cannot_be_drawn_are_refused(
    size: list[int], shapes: list[object] | None, tmp_path: Path
) -> None:
    photographs = [{"file": "0.png", "held_out": False, "shapes": shapes}] if shapes else []
    file = tmp_path / "drawn.yaml"
    file.write_text(yaml.safe_dump({"size": size, "photographs": photographs}))
    with pytest.raises(ConfigError, match="expected"):
        load_annotations(str(file))


def test_labels_that_excel_wrote_are_read(tmp_path: Path) -> None:
    write_pictures(tmp_path / "images")
    (tmp_path / "labels.csv").write_bytes(b"\xef\xbb\xbffile,angle\r\n0.png,0.5\r\n")
    assert load_drive(tmp_path).steering_deg.tolist() == [15.0]


@pytest.mark.parametrize("text", ['{"paths": 5}', '{"paths": ["a"], "deleted_indexes": 5}'])
def test_a_tub_with_an_odd_manifest_ends_in_a_line(text: str, tmp_path: Path) -> None:
    (tmp_path / "manifest.json").write_text(text)
    (tmp_path / "a").write_text('{"_index": 0, "cam/image_array": "x.jpg", "user/angle": 0.1}')
    with pytest.raises(ConfigError, match="expected"):
        load_drive(tmp_path)


def test_a_map_that_is_a_number_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "five.yaml").write_text("5")
    out = str(tmp_path / "out")
    assert main(["collect", "--map", str(tmp_path / "five.yaml"), "--out", out]) == 2
    assert "five" in capsys.readouterr().err
