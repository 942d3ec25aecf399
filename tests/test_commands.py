"""The command lines that scripts of other people may depend on: they stay."""

from __future__ import annotations

from collections.abc import Callable

import pytest

import localizer_node.__main__
import tools.loop.__main__
import trainer.cli
from robot.cli import main as robot
from tools.loop.cli import LoopOptions

TRAIN = "--task --algo --preset --map --out --seed --resume"
EVALUATE = "--model --task --map --look --pose-error --zero --episodes --seed --json"
STABLE = [
    (trainer.cli.main, "train", TRAIN),
    (trainer.cli.main, "evaluate", EVALUATE),
    (trainer.cli.main, "explain", "--model --images --out"),
    (trainer.cli.main, "report", "--out"),
    (trainer.cli.main, "export", ""),
    (trainer.cli.main, "experiment six-models", "--out --seeds --ray"),
    (trainer.cli.main, "experiment paper-b-transfer", "--out --seeds --ray"),
    (trainer.cli.main, "experiment paper-b-accuracy", "--out --seeds --data"),
    (robot, "infer", "--model --images --json"),
    *[
        (robot, name, "")
        for name in ["drive", "doctor", "calibrate", "selftest", "bench", "keygen", "install"]
    ],
    (localizer_node.__main__.main, "locate", "--image --calibration --json"),
    (localizer_node.__main__.main, "run", ""),
    (localizer_node.__main__.main, "calibrate", ""),
    (tools.loop.__main__.main, "", "--map --start --goal --realtime --json"),
]


@pytest.mark.parametrize(("main", "command", "options"), STABLE, ids=[row[1] for row in STABLE])
def test_a_stable_command_keeps_its_options(
    main: Callable[[list[str]], int],
    command: str,
    options: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    with pytest.raises(SystemExit) as ended:
        main([*command.split(), "--help"])
    assert ended.value.code == 0
    told = capsys.readouterr().out
    assert [option for option in options.split() if option not in told] == []


def test_the_loop_drives_a_mission_with_the_shipped_policy_unless_told() -> None:
    options = LoopOptions()
    assert (options.missions, options.road, options.realtime) == (1, "arena", False)
    assert options.policy.is_file()
    assert LoopOptions(start="1,2", goal="0.5,0.25").place("goal") == (0.5, 0.25)
    assert LoopOptions(laps=1.0).policy.is_file()


@pytest.mark.parametrize(
    "words", ["--start 1", "--goal a,b", "--start nan,1", "--goal 1,1 --missions 2"]
)
def test_a_place_that_is_none_is_refused(words: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert tools.loop.__main__.main(words.split()) == 2
    assert "expected" in capsys.readouterr().err
