"""Whatever ends a command, a person reads one line."""

import errno
from typing import List

import pytest

from robot.command_line import OneLineParser, answer, number, whole
from robot.errors import ConfigError, HardwareError


def raising(error: BaseException) -> int:
    def work() -> int:
        raise error

    return answer("tool", work)


@pytest.mark.parametrize(
    ("error", "status", "said"),
    [
        (ConfigError("seed: expected\n 0"), 2, "tool: seed: expected 0\n"),
        (HardwareError("no HAT"), 1, "tool: no HAT\n"),
        (KeyboardInterrupt(), 130, "tool: stopped by Ctrl-C\n"),
        (
            FileNotFoundError(errno.ENOENT, "No such file", "x.png"),
            2,
            "tool: x.png: No such file\n",
        ),
        (OSError(errno.ENOSPC, "No space left", "x.png"), 1, "tool: x.png: No space left\n"),
        (
            ModuleNotFoundError("No module named 'tyro'", name="tyro"),
            2,
            "tool: expected the package tyro, found none; in a clone pip install '.[trainer]' "
            "brings it\n",
        ),
    ],
)
def test_what_a_person_can_mend_is_one_line(
    error: BaseException, status: int, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert raising(error) == status
    assert capsys.readouterr().err == said


@pytest.mark.parametrize(
    "error", [ZeroDivisionError(), ModuleNotFoundError("ours", name="robot.nosuch")]
)
def test_our_own_errors_are_not_hidden(error: Exception) -> None:
    with pytest.raises(type(error)):
        raising(error)


def test_work_that_ends_gives_its_status() -> None:
    assert answer("tool", lambda: None) == 0
    assert answer("tool", lambda: 1) == 1


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--seed", "-1"], "expected a whole number from 0 to 9, got '-1'"),
        (["--seed", "1.5"], "expected a whole number from 0 to 9, got '1.5'"),
        (["--share", "nan"], "expected a number from 0 to 1, got 'nan'"),
        (["--share", "inf"], "expected a number from 0 to 1, got 'inf'"),
        (["--kind", "tga"], "unknown 'tga'; did you mean 'tag'? valid: plain, tag"),
        (["--sede", "1"], "unknown --sede 1; did you mean --seed?"),
        (["x" * 9999], "unknown xxx"),
    ],
)
def test_wrong_words_are_one_short_line_that_says_what_would_be_right(
    words: List[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    parser = OneLineParser(prog="tool")
    parser.add_argument("--seed", type=whole(0, 9))
    parser.add_argument("--share", type=number(0, 1))
    parser.add_argument("--kind", choices=["tag", "plain"])
    with pytest.raises(SystemExit) as ended:
        parser.parse_args(words)
    assert ended.value.code == 2
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1
    assert len(error) < 600
