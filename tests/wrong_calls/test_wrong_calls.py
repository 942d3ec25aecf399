"""Hundreds of wrong calls: status 2, one line that says what is wrong, and no file touched."""

from __future__ import annotations

import importlib
import os
import shlex
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml

ROOT = Path(__file__).parents[2]
MODELS = ROOT / "robot" / "models"
ROWS = [
    tuple(line.split(" :: "))
    for line in (Path(__file__).parent / "calls.txt").read_text(encoding="utf-8").splitlines()
    if line and not line.startswith("#")
]
MAINS = {"robot": "robot.cli", "trainer": "trainer.cli", "duckpilot": "robot.cli.duckpilot"}
MAINS.update({name: f"{name}.__main__" for name in ("localizer_node", "tools.loop")})
MAINS.update({name: f"{name}.__main__" for name in ("tools.faults", "tools.monitor")})


TEXTS = {
    "file": "kept",
    "empty": "",
    "list_yaml": "[1, 2]\n",
    "cut_yaml": "camera: {width: [1, 2",
    "typo_yaml": "camra: {}\n",
    "kind_yaml": "hat: {left: 3}\n",
    "robot_yaml": "model: policy.onnx\n",
    "deep": "[" * 20_000,
    "cut_json": '{"inputs": {',
    "rows_json": '{"outcomes": [{"name": 1}]}',
    "no_road": yaml.safe_dump({"tiles": [["floor", "grass"]] * 2, "tile_size": 0.585}),
    "bomb": "\n".join(
        ["a0: &a0 [x, x, x, x, x, x, x, x]"]
        + [f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 8)}]" for k in range(1, 12)]
    ),
}  # by the name that calls.txt has for the file


@pytest.fixture(scope="module")
def names(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, str]]:
    """What the names in braces stand for."""
    here = tmp_path_factory.mktemp("calls")
    found = {name: here / f"{name}.yaml" for name in TEXTS}
    for name, text in TEXTS.items():
        found[name].write_text(text, encoding="utf-8")
    parts = {
        "cut_onnx": ("cut.onnx", (MODELS / "lane_dueling.onnx").read_bytes()[:5000]),
        "any_onnx": ("any.onnx", (ROOT / "tests/robot/fixtures/lane.onnx").read_bytes()),
        "cut_mcap": ("cut.mcap", b"\x89MCAP0\r\n\x01"),
        "cut_pt": ("cut.pt", b"PK\x03\x04" + bytes(500)),
        "latin": ("latin.yaml", "name: Größe\n".encode("latin-1")),
    }
    for name, (file, data) in parts.items():
        found[name] = here / file
        found[name].write_bytes(data)
    for folder in ("folder", "pictures", "rubbish", "run", "bad_run", "tub"):
        found[folder] = here / folder
        found[folder].mkdir()
    picture = np.random.default_rng(0).integers(0, 255, (48, 64, 3), np.uint8)
    cv2.imwrite(str(found["pictures"] / "a.png"), picture)
    found["cut_png"] = here / "cut.png"
    found["cut_png"].write_bytes((found["pictures"] / "a.png").read_bytes()[:20])
    (found["rubbish"] / "._a.jpg").write_bytes(b"\0\5\x16\7")
    (found["tub"] / "manifest.json").write_text('{"paths": ["c.catalog"]}\n')
    (found["tub"] / "c.catalog").write_bytes(bytes(40) + b"\n")
    _write_run(found["run"])
    (found["bad_run"] / "config.yaml").write_text("task: [lane\n")
    found["calibration"] = _calibration(here / "calibration.yaml")
    found |= {n: MODELS / f"{n}_dueling.onnx" for n in ("lane", "nav")}
    found |= {"track": MODELS / "track_ppo.onnx", "none": here / "none", "new": here / "new"}
    with socket.socket() as busy:
        busy.bind(("127.0.0.1", 0))
        busy.listen()
        corners = "--corner 10,470 --corner 630,470 --corner 630,10 --corner 10,10"
        yield {
            **{name: str(path) for name, path in found.items()},
            "corners": corners,
            "busy": str(busy.getsockname()[1]),
        }


def _write_run(folder: Path) -> None:
    from trainer.presets import preset
    from trainer.run import RunFolder

    RunFolder(folder).go_on(preset("lane", "ppo", "debug"))


def _calibration(path: Path) -> Path:
    from robot.output import write_yaml
    from tests.localizer_node.rigs import Rig

    write_yaml(path, Rig().calibration())
    return path


def _touched(here: Path) -> dict[Path, tuple[int, int]]:
    return {
        p: (p.stat().st_mtime_ns, p.stat().st_size) if p.is_file() else (0, 0)
        for p in here.rglob("*")
    }


def test_there_are_hundreds_of_different_ones() -> None:
    assert len({row[0] for row in ROWS}) == len(ROWS) >= 250


@pytest.mark.parametrize(("call", "said"), ROWS, ids=[row[0] for row in ROWS])
def test_a_wrong_call_ends_in_one_line_and_status_2(
    call: str,
    said: str,
    names: dict[str, str],
    capfd: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    program, *words = shlex.split(call.format(**names))
    here = Path(names["file"]).parent
    monkeypatch.chdir(here / "folder")
    monkeypatch.setattr("sys.argv", [program, *words])
    main = importlib.import_module(MAINS.get(program, program)).main
    before = _touched(here)
    try:
        status = main(words)
    except SystemExit as ended:
        status = ended.code
    told = capfd.readouterr().err
    assert (status, told.count("\n")) == (2, 1), told
    assert said.format(**names) in told
    assert "Traceback" not in told
    assert len(told) < 2500
    assert _touched(here) == before


BLOCKED = """
import runpy, sys

class Blocked:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in {"tyro", "rich", "fastapi", "uvicorn"}:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, Blocked())
program, *words = sys.argv[1:]
sys.argv = ["-m", *words]  # as Python itself while it imports the packages of a program
runpy.run_module(program, run_name="__main__", alter_sys=True)
"""


@pytest.mark.parametrize(
    ("call", "extra"),
    [
        ("trainer train --out x", "trainer"),
        ("robot.cli.duckpilot train --out x", "trainer"),
        ("robot.cli.duckpilot loop", "trainer"),
        ("tools.demo", "trainer"),
        ("tools.loop", "trainer"),
        ("tools.monitor --demo", "trainer"),  # which brings what reads the words
    ],
)
def test_a_missing_extra_is_told_with_what_brings_it(call: str, extra: str, tmp_path: Path) -> None:
    command = [sys.executable, "-c", BLOCKED, *call.split()]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    ended = subprocess.run(
        command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
    )
    assert (ended.returncode, ended.stderr.count("\n")) == (2, 1), ended.stderr
    assert f"pip install '.[{extra}]'" in ended.stderr
    assert list(tmp_path.iterdir()) == []


def test_ctrl_c_while_a_program_is_imported_is_one_line(tmp_path: Path) -> None:
    code = BLOCKED.replace(
        'raise ModuleNotFoundError(f"No module named {name!r}", name=name)',
        "raise KeyboardInterrupt",
    )
    command = [sys.executable, "-c", code, "tools.demo"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    ended = subprocess.run(
        command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
    )
    assert (ended.returncode, ended.stderr) == (130, "tools.demo: stopped by Ctrl-C\n")


@pytest.mark.parametrize("program", ["trainer", "robot", "localizer_node", "tools.monitor"])
def test_help_takes_no_second_of_the_processor(program: str) -> None:
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    before = os.times()
    command = [sys.executable, "-m", program, "--help"]
    subprocess.run(command, env=environment, capture_output=True, check=True)
    after = os.times()
    used_s = sum(after[2:4]) - sum(before[2:4])  # of children
    assert used_s < 1.0
