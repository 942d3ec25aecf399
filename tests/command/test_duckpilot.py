"""``duckpilot``: one name for every command; help comes fast, and names what there is."""

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from robot.cli import duckpilot

ROOT = Path(__file__).parents[2]
PROMISED = [
    "train",
    "evaluate",
    "export",
    "explain",
    "report",
    "experiment",
    "translate",
    "parse",
    "loop",
    "faults",
    "monitor",
    "replay",
    "demo",
    "localizer",
    "drive",
    "infer",
    "doctor",
    "selftest",
    "calibrate",
    "keygen",
    "install",
    "off",
    "bench",
]
# What takes a tenth of a second or more to import, and none of which help needs.
HEAVY = [
    "torch",
    "stable_baselines3",
    "gymnasium",
    "pybullet",
    "numba",
    "onnx",
    "onnxruntime",
    "cv2",
    "matplotlib",
    "scipy",
    "ray",
    "tensorboard",
    "fastapi",
    "uvicorn",
    "zmq",
    "mcap",
]

# Asks each call for its help, in a process of its own; tells its status and what it imported.
ASK = """
import contextlib, io, json, os, sys
from robot.cli import duckpilot
for call in json.loads(sys.argv[1]):
    ours, theirs = os.pipe()
    if os.fork() == 0:
        told = io.StringIO()
        try:
            with contextlib.redirect_stdout(told):
                status = duckpilot.main([*call, "--help"])
        except SystemExit as ended:
            status = ended.code
        heavy = [name for name in json.loads(sys.argv[2]) if name in sys.modules]
        os.write(theirs, json.dumps([status, heavy, told.getvalue()]).encode())
        os._exit(0)
    os.close(theirs)
    with os.fdopen(ours) as answer:
        print(answer.read())
    os.wait()
"""


def calls() -> Iterator[list[str]]:
    """Every command, and those within a command."""
    from trainer.cli import COMMANDS, Command

    yield []
    for group in duckpilot.programs().values():
        yield from ([name] for name in group)
    for name, within in COMMANDS.items():
        if not isinstance(within, Command):
            yield from ([name, word] for word in within)
    yield from (["localizer", word] for word in ("run", "locate", "calibrate"))


def test_help_of_anything_is_there_and_imports_nothing_heavy() -> None:
    asked = list(calls())
    command = [sys.executable, "-c", ASK, json.dumps(asked), json.dumps(HEAVY)]
    ended = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    answers = [json.loads(line) for line in ended.stdout.splitlines()]
    assert len(answers) == len(asked) > 30
    slow = {" ".join(c): heavy for c, (_, heavy, _) in zip(asked, answers, strict=True) if heavy}
    assert slow == {}
    for call, (status, _, told) in zip(asked, answers, strict=True):
        assert status == 0, call
        assert " ".join(["usage: duckpilot", *call]) in " ".join(told.split()), told
        assert "python -m trainer" not in told.split("\n")[0]


def test_help_tells_every_command_in_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert duckpilot.main(["--help"]) == 0
    lines = capsys.readouterr().out.splitlines()
    for name in {*PROMISED, *(name for group in duckpilot.programs().values() for name in group)}:
        (line,) = [line for line in lines if line.startswith(f"  {name} ")]
        assert len(line) <= 100
        assert len(line.split()) >= 3, "a name without a purpose"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ([], "expected a command, got none"),
        (["trian"], "did you mean 'train'?"),
        (["locals"], "did you mean 'localizer'?"),
        (["--version"], "unknown command"),
    ],
)
def test_an_unknown_command_names_the_nearest(
    words: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert duckpilot.main(words) == 2
    told = capsys.readouterr().err
    assert said in told
    assert told.count("\n") == 1


def test_an_older_python_offers_the_robots_commands_only(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "version_info", (3, 8, 10))
    assert duckpilot.main(["--help"]) == 0
    told = capsys.readouterr().out
    assert "  drive " in told
    assert "  localizer " in told
    offered = {line.split()[0] for line in told.splitlines() if line}
    assert not {"train", "monitor", "loop"} & offered
    assert duckpilot.main(["train"]) == 2
    assert "Python 3.11 and pip install '.[trainer,monitor]'" in capsys.readouterr().err


def test_what_a_command_says_bears_the_name_that_was_typed(
    capsys: pytest.CaptureFixture[str],
) -> None:
    for words in (["train"], ["infer"], ["loop", "--missoins", "1"], ["localizer", "locate"]):
        with pytest.raises(SystemExit) as ended:
            duckpilot.main(words)
        assert ended.value.code == 2
        told = capsys.readouterr().err
        assert told.startswith(f"duckpilot {words[0]}"), told
        assert "python -m" not in told


def test_words_reach_the_program(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert duckpilot.main(["keygen", str(tmp_path / "keys")]) == 0
    assert list((tmp_path / "keys").iterdir())
    assert duckpilot.main(["replay", str(tmp_path / "none.mcap")]) == 2
    assert "none.mcap" in capsys.readouterr().err
