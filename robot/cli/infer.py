"""Run a policy over pictures: which action it would choose on each.

A picture of any size is cut to its middle 4:3 and resized by area to the 160x120 of a camera frame,
as a real camera's pictures are. A navigating policy is given a path straight ahead, one that is
told its last commands that it stood.
"""

import argparse
from pathlib import Path
from typing import Any, Dict, List, Tuple

import numpy as np

from robot.camera.files import picture_files, read_picture
from robot.camera.source import fit_to_frame
from robot.contract import action_name
from robot.errors import ConfigError
from robot.inference.policy import OnnxPolicy, values_of
from robot.output import expect_writable, write_json


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The command's options."""
    parser.add_argument("--model", type=Path, required=True, help="an ONNX policy")
    parser.add_argument("--images", type=Path, required=True, help="folder, searched in depth")
    parser.add_argument("--json", type=Path, required=True, help="file to write: action and values")


def run(options: argparse.Namespace) -> None:
    """Do it; DuckpilotError for a wrong model, a folder without pictures, no place for results."""
    expect_writable(options.json, inputs=[options.model, *picture_files(options.images)])
    policy = OnnxPolicy(options.model)
    images, skipped = label(policy, options.images)
    inputs = {
        "model": str(options.model),
        "images": str(options.images),
        "task": policy.contract.task,
        "fit": "middle 4:3, resized by area to 160x120",
        "path": "straight ahead" if policy.contract.path_points else None,
    }
    write_json(options.json, {"schema": 1, "inputs": inputs, "images": images, "skipped": skipped})
    names = [action_name(wheels) for wheels in policy.contract.actions]
    counts = [sum(each["action"] == i for each in images) for i in range(len(names))]
    summary = ", ".join(f"{name} {count}" for name, count in zip(names, counts))
    print(f"{len(images)} pictures: {summary}")
    if skipped:
        print(f"skipped {len(skipped)} that OpenCV cannot read, such as {skipped[0]}")


def label(policy: OnnxPolicy, folder: Path) -> Tuple[List[Dict[str, Any]], List[str]]:
    """File, action and values of each picture of a folder, and what only has a picture's name.

    Such are empty files, or macOS's ._*.jpg. ConfigError: there is no picture.
    """
    path = np.zeros(policy.contract.path_points, np.float32)
    answers, skipped = [], []
    for file in picture_files(folder):
        name = file.relative_to(folder).as_posix()
        try:
            frame = fit_to_frame(read_picture(file))
        except ConfigError:
            skipped.append(name)
            continue
        values = np.asarray(values_of(policy, frame, path))
        shown = [round(float(value), 6) for value in values]
        answers.append({"file": name, "action": int(values.argmax()), "values": shown})
    if not answers:
        raise ConfigError(f"{folder / skipped[0]}: expected a picture, got only its name")
    return answers, skipped
