"""Run a policy over pictures: which action it would choose on each.

A picture of any size is cut to its middle 4:3 and resized by area to the 160x120 of a camera frame,
as a real camera's pictures are. A navigating policy is given a path straight ahead.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import List, NamedTuple, Tuple

import numpy as np

from robot.camera.replay import picture_files, read_picture
from robot.camera.source import fit_to_frame
from robot.cli.contact_sheet import Labelled, draw_sheet
from robot.contract import action_name
from robot.errors import ConfigError
from robot.inference.policy import OnnxPolicy
from robot.inference.preprocess import preprocess
from robot.output import expect_writable, write_json, write_png

PROGRESS_EVERY = 25
NAMED = 3  # of the files that were skipped


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The command's options."""
    parser.add_argument("--model", type=Path, required=True, help="an ONNX policy")
    parser.add_argument("--images", type=Path, required=True, help="folder, searched in depth")
    parser.add_argument("--json", type=Path, required=True, help="file to write: action and values")
    parser.add_argument("--sheet", type=Path, help="PNG to write: pictures, arrows and bars")


def run(options: argparse.Namespace) -> None:
    """Do it; DuckpilotError for a wrong model, a folder without pictures, no place for results."""
    expect_writable(options.json, options.sheet, inputs=[options.model])
    policy = OnnxPolicy(options.model)
    labelled, skipped = label(policy, options.images)
    inputs = {
        "model": str(options.model),
        "images": str(options.images),
        "task": policy.contract.task,
        "fit": "middle 4:3, resized by area to 160x120",
        "path": "straight ahead" if policy.contract.path_points else None,
    }
    images = [
        {
            "file": each.name,
            "action": each.action,
            "values": [round(float(value), 6) for value in each.values],
        }
        for each in labelled
    ]
    write_json(
        options.json, {"schema": 1, "inputs": inputs, "images": images, "skipped": list(skipped)}
    )
    if options.sheet:
        write_png(options.sheet, draw_sheet(labelled, policy.contract.actions))
    names = [action_name(wheels) for wheels in policy.contract.actions]
    counts = [sum(each.action == i for each in labelled) for i in range(len(names))]
    summary = ", ".join(f"{name} {count}" for name, count in zip(names, counts))
    print(f"{len(labelled)} pictures: {summary}")
    if skipped:
        more = f" and {len(skipped) - NAMED} more" if len(skipped) > NAMED else ""
        print(f"skipped {len(skipped)} that are no pictures: {', '.join(skipped[:NAMED])}{more}")


class Answers(NamedTuple):
    """What a policy made of a folder."""

    labelled: List[Labelled]
    skipped: Tuple[str, ...]  # files that only have a picture's name: empty, or macOS's ._*.jpg


def label(policy: OnnxPolicy, folder: Path) -> Answers:
    """The policy's answer to each picture of a folder, one at a time as on the robot.

    Raises:
        ConfigError: there is none.
    """
    files = picture_files(folder)
    path = np.zeros((1, policy.contract.path_points), np.float32)
    labelled, skipped, first = [], [], None
    for i, file in enumerate(files):
        name = file.relative_to(folder).as_posix()
        try:
            frame = fit_to_frame(read_picture(file))
        except ConfigError as error:
            skipped.append(name)
            first = first or error
            continue
        picture = preprocess(frame, policy.contract.image)
        values = policy.values(picture[None], path if path.size else None)[0]
        labelled.append(Labelled(name, frame, int(values.argmax()), values))
        if sys.stderr.isatty() and (i + 1) % PROGRESS_EVERY == 0:
            print(f"\r{i + 1} of {len(files)} pictures", end="", file=sys.stderr, flush=True)
    if sys.stderr.isatty():
        print("\r\033[K", end="", file=sys.stderr)
    if first is not None and not labelled:
        raise first
    return Answers(labelled, tuple(skipped))
