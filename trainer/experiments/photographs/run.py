"""All that real photographs say of some policies, kept part by part, and one page of tables."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeVar

import cv2
import numpy as np
import torch
from rich.console import Console

from robot.contract import ImageSpec
from robot.errors import ConfigError
from robot.inference.policy_file import read_contract
from robot.navigation.road_map import load_map
from robot.typed_config import from_plain, to_plain
from sim_pybullet.look import NOMINAL
from sim_pybullet.randomise import load_look_sampler
from trainer.config import choose
from trainer.experiments.driving_pictures import load_stacks, split_by_time
from trainer.experiments.photographs import tables
from trainer.experiments.photographs.agreement import SiteAgreement, compare_lines
from trainer.experiments.photographs.attention import (
    SiteAttention,
    attention_by_site,
    attention_sheet,
    labelled_frames,
)
from trainer.experiments.photographs.lane_pose import SitePose, read_photographs, site_pose
from trainer.experiments.photographs.steering import (
    Steered,
    compare_steering,
    frames_of_drive,
)
from trainer.experiments.records import Turn, load_drive
from trainer.experiments.supervised import teach_turns
from trainer.experiments.table1 import Accuracy, chance, compare
from trainer.judging.lane_head import LanePoseHead, lane_samples, teach_lane_pose
from trainer.run import atomically, write_json

DRIVE = "donkeycar_dashed_track"
MAPS = ("loop", "town", "village", "suburb")
TEST_LOOK = "reality"
_TITLES = {
    "attention": "Lines that policies look at",
    "agreement": "The yellow line",
    "lane_pose": "Lane pose",
    "steering": "Steering",
}
_TEST_SHARE = 8  # one simulated frame of so many is for the test

Row = TypeVar("Row", SiteAttention, SiteAgreement, SitePose, Steered)


@dataclass(frozen=True)
class Photographs:
    """What was asked for; parts of the answer that were made for other policies are made anew."""

    data: Path  # holds the folders of the sites
    out: Path
    policies: tuple[tuple[str, Path], ...]  # names and ONNX files
    frames: int  # simulated ones that lane-pose heads learn from
    seeds: int  # supervised networks
    steps: int  # updates of each
    only: tuple[str, ...]  # parts


def named(given: Sequence[str]) -> tuple[tuple[str, Path], ...]:
    """(name, file) of each ``name=model.onnx``.

    Raises:
        ConfigError: another form, no file, or a name twice.
    """
    found: dict[str, Path] = {}
    for text in given:
        name, _, path = text.partition("=")
        if not path or name in found or not Path(path).is_file():
            raise ConfigError(f"--policy: expected name=model.onnx, each name once, got {text!r}")
        found[name] = Path(path)
    return tuple(found.items())


def look_at_photographs(asked: Photographs, console: Console) -> str:
    """Do what is not done yet; the tables.

    Raises:
        DuckpilotError: a photograph is missing, or a policy is none.
    """
    torch.set_num_threads(1)
    policies = [f"{name} {path} {path.stat().st_size}" for name, path in asked.policies]
    learning = [*policies, asked.frames]
    steering = [*policies, asked.seeds, asked.steps]
    parts: dict[str, Callable[[], str]] = {
        "attention": lambda: tables.attention_table(
            _kept(asked, "attention", policies, SiteAttention, _look)
        ),
        "agreement": lambda: tables.agreement_table(
            _kept(asked, "agreement", [], SiteAgreement, _detect)
        ),
        "lane_pose": lambda: tables.pose_table(
            _kept(asked, "lane_pose", learning, SitePose, _poses)
        ),
        "steering": lambda: tables.steering_table(
            _kept(asked, "steering", steering, Steered, _steer(console))
        ),
    }
    chosen = [choose("only", name, parts) for name in asked.only]
    if not asked.data.is_dir():
        raise ConfigError(f"{asked.data}: expected the folder of the sites, got no such folder")
    asked.out.mkdir(parents=True, exist_ok=True)
    texts = [
        f"## {_TITLES[name]}\n\n{part()}" for name, part in zip(asked.only, chosen, strict=True)
    ]
    text = "\n".join(texts)
    with atomically(asked.out / "tables.md") as temporary:
        temporary.write_text(text, encoding="utf-8")
    return text


def _kept(
    asked: Photographs,
    name: str,
    inputs: list[Any],
    kind: type[Row],
    make: Callable[[Photographs], list[Row]],
) -> list[Row]:
    """The rows of a part, from its file if that answers the same question."""
    path = asked.out / f"{name}.json"
    if path.exists():
        found = json.loads(path.read_text(encoding="utf-8"))
        if found["inputs"] == inputs:
            return [from_plain(kind, _with_nan(row), str(path)) for row in found["rows"]]
    rows = make(asked)
    write_json(path, {"inputs": inputs, "rows": [to_plain(row) for row in rows]})
    return rows


def _with_nan(row: dict[str, Any]) -> dict[str, Any]:
    return {key: math.nan if value is None else value for key, value in row.items()}


def _look(asked: Photographs) -> list[SiteAttention]:
    frames = labelled_frames(asked.data)
    _write_png(asked.out / "attention.png", attention_sheet(asked.policies, frames))
    rows = [attention_by_site(name, path, frames) for name, path in asked.policies]
    return [row for each in rows for row in each]


def _detect(asked: Photographs) -> list[SiteAgreement]:
    return compare_lines(asked.data, NOMINAL.rig())


def _poses(asked: Photographs) -> list[SitePose]:
    rows: list[SitePose] = []
    sampled = lru_cache(_samples)  # policies of one preset see the same pictures
    for name, path in asked.policies:
        image = read_contract(path).image
        file = asked.out / f"{name}_{path.stat().st_size}_{asked.frames}_lane_pose.onnx"
        if not file.exists():
            teach_lane_pose(path, *sampled(image, "randomised", asked.frames, 0), file)
        head = LanePoseHead(file, image)
        pictures, poses = sampled(image, TEST_LOOK, max(64, asked.frames // _TEST_SHARE), 1)
        rows.append(site_pose(name, f"simulated, {TEST_LOOK}", head(pictures), poses))
        found, sheet = read_photographs(name, head, image, asked.data, NOMINAL.rig())
        rows += found
        _write_png(asked.out / f"{name}_lane_pose.png", sheet)
    return rows


def _write_png(path: Path, picture: np.ndarray) -> None:
    with atomically(path) as temporary:
        temporary.write_bytes(cv2.imencode(".png", picture[..., ::-1])[1].tobytes())


def _samples(image: ImageSpec, look: str, frames: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    maps = [load_map(name) for name in MAPS]
    return lane_samples(maps, load_look_sampler(look), frames, image, seed)


def _steer(console: Console) -> Callable[[Photographs], list[Steered]]:
    def make(asked: Photographs) -> list[Steered]:
        drive = load_drive(asked.data / DRIVE)
        if drive.skipped:
            console.print(f"{asked.data / DRIVE}: skipped {drive.skipped} broken records")
        training, test = split_by_time(load_stacks(drive, ImageSpec(80, 60, 20)))
        common = int(np.bincount(training.turns, minlength=len(Turn)).argmax())
        rows = [_without_order(row) for row in chance(test.turns, common)]
        frames = frames_of_drive(drive)
        for name, path in asked.policies:
            rows += compare_steering(name, path, frames, drive.steering_deg, NOMINAL.rig())
        for seed in range(asked.seeds):
            checkpoint = asked.out / f"supervised_{seed}_{asked.steps}.pt"
            network = teach_turns(training, asked.steps, seed, checkpoint, console)
            guessed = network.turns(test.stacked())
            rows.append(_without_order(compare("supervised", seed, test.turns, guessed)))
        return rows

    return make


def _without_order(row: Accuracy) -> Steered:
    return Steered(row, math.nan, math.nan)
