"""The command line. Exit status: 0 done, 2 wrong input, 130 Ctrl-C, 1 anything else.

A command is imported when it is asked for: to read what there is takes no torch.
"""

import contextlib
import dataclasses
import functools
import importlib
import inspect
import io
import itertools
import re
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

from robot.command_line import WRONG, answer, one_line, spoken
from robot.errors import DuckpilotError, expect_between, nearest
from robot.output import expect_folder, expect_writable

PROGRAM = "python -m trainer"
_LISTS = ("--map", "--without", "--judge-map", "--sim", "--real", "--pairs", "--look")
_FRAME = "│╭╮╰╯┆ "

# Of every command that has an option of this name.
_LIMITS: Mapping[str, tuple[float, float]] = {
    **dict.fromkeys(("steps", "ppo_steps", "lane_steps", "translator_steps"), (1, 10**12)),
    **dict.fromkeys(("episodes", "frames"), (1, 10_000_000)),
    **dict.fromkeys(("drives", "lap_drives"), (1, 1_000_000)),
    **dict.fromkeys(("missions", "files", "choosing_files", "batch"), (1, 100_000)),
    **dict.fromkeys(("seeds", "size"), (1, 10_000)),
    "seed": (0, 2**31 - 1),
    "cyclegan": (0, 10**12),
    "workers": (1, 1_000),
    "laps": (0.01, 10_000),
    "held_out": (0.01, 0.99),
    "gpus": (0, 1),
    "port": (1024, 65_535),
    "structure": (0.0, 1e6),
    "rate_hz": (0.1, 1e4),
}
_OUT_IS_FILE = ("export", "fit", "parse export", "plot", "split", "cut")


@dataclass(frozen=True)
class Command:
    """Where a command is, and what it is for."""

    place: str  # module:function
    purpose: str = ""  # told where there are several


Group = Mapping[str, "Command | Group"]
_RUN, _SEE, _TRY = "trainer.commands", "trainer.transfer.cli", "trainer.experiments.cli"
COMMANDS: Group = {
    "train": Command(f"{_RUN}:train_command", "train a policy"),
    "train-sight": Command("trainer.sight.cli:train_command", "teach the network that sees lanes"),
    "sight": Command("trainer.sight.cli:draw_command", "draw what sight sees over pictures"),
    "evaluate": Command(f"{_RUN}:evaluate_command", "drive a policy, and count successes"),
    "judge": Command("trainer.judging.cli:judge_command", "drive an AI Driving Olympics challenge"),
    "export": Command(f"{_RUN}:export_command", "write a run's policy as ONNX, FP32 and INT8"),
    "fit": Command("trainer.twin.cli:fit_command", "a twin of your robot and floor, by driving"),
    "teach": Command("trainer.twin.cli:teach_command", "teach a policy your floor, and prove it"),
    "report": Command(f"{_RUN}:report_command", "one page over runs: curves, tables, films"),
    "explain": Command(f"{_RUN}:explain_command", "show what a policy looks at"),
    "collect": Command(f"{_SEE}:collect_command", "gather labelled frames from the simulator"),
    "translate": {
        "train": Command(f"{_SEE}:translate_train_command", "CycleGAN, simulator to photographs"),
        "judge": Command(f"{_SEE}:translate_judge_command", "colours, and what stays of lines"),
    },
    "parse": {
        "train": Command(f"{_SEE}:parse_train_command", "teach SegNet to label frames"),
        "export": Command(f"{_SEE}:parse_export_command", "write a parser as a translator, ONNX"),
        "translate": Command(f"{_SEE}:parse_translate_command", "virtual to parsing to real"),
    },
    "experiment": {
        "six-models": Command(f"{_TRY}:six_models_command", "ways to reality: paper A, 4.4"),
        "paper-b-accuracy": Command(f"{_TRY}:table1_command", "a person's steering: Table 1"),
        "paper-b-transfer": Command(f"{_TRY}:figure5_command", "race tracks: Figure 5"),
    },
}
PURPOSES = {
    "translate": "CycleGAN: train and judge translators of pictures",
    "parse": "scene parsing: train and export it, and translate by way of it",
    "experiment": "the papers' comparisons, one command each",
}


def run(
    commands: Command | Group, arguments: Sequence[str] | None = None, *, prog: str = PROGRAM
) -> int:
    """Run one of the commands of ``prog``, or its only one; the exit status."""
    words = list(sys.argv[1:] if arguments is None else arguments)

    def work() -> int:
        name, command, rest = _chosen(words, prog, commands)
        module, _, function = command.place.partition(":")
        do: Callable[..., int] = getattr(importlib.import_module(module), function)
        options = _read(do, rest, f"{prog} {name}".strip())
        _check(name, options)
        return do(**options)

    return answer(spoken(prog), work)


main = functools.partial(run, COMMANDS)


def _chosen(
    words: list[str], program: str, found: Command | Group
) -> tuple[str, Command, list[str]]:
    """The command, its name and the words after it; help and wrong names end the program."""
    names: list[str] = []
    while not isinstance(found, Command):
        prog = " ".join([program, *names])
        word = words[len(names)] if len(words) > len(names) else ""
        if word in ("-h", "--help"):
            print(_help(prog, found))
            raise SystemExit(0)
        if word not in found:
            got = f"unknown command {word[:80]!r}" if word else "expected a command, got none"
            _refuse(prog, f"{got}; {nearest(word, found)}")
        names.append(word)
        found = found[word]
    return " ".join(names), found, words[len(names) :]


def _help(prog: str, commands: Group) -> str:
    told = ((name, getattr(each, "purpose", PURPOSES.get(name))) for name, each in commands.items())
    rows = [f"  {name:17} {purpose}" for name, purpose in told]
    about = [f"usage: {prog} COMMAND …", "", *rows, "", f"{prog} COMMAND --help tells its options."]
    return "\n".join(about)


def _read(command: Callable[..., int], words: list[str], prog: str) -> dict[str, Any]:
    """What the command is to be called with; wrong words end the program in one line."""
    import tyro

    @functools.wraps(command)
    def options_of(*args: Any, **kwargs: Any) -> dict[str, Any]:
        options = inspect.signature(command).bind(*args, **kwargs).arguments
        if "given" in options:  # else a default that is asked for cannot be told from none
            names = {w[2:].split("=")[0].replace("-", "_") for w in words if w[:2] == "--"}
            options["given"] = tuple(names | {n[3:] for n in names if n.startswith("no_")})
        return options

    for word, after in itertools.pairwise([*words, "--"]):
        if word in _LISTS and after.startswith("--"):
            _refuse(prog, f"{word}: expected one or more, got none")
    told = io.StringIO()
    try:
        with contextlib.redirect_stderr(told):
            options: dict[str, Any] = tyro.cli(options_of, args=words, prog=prog)
    except SystemExit as ended:
        if not ended.code:
            raise
        _refuse(prog, _first_of(told.getvalue()))
    except DuckpilotError as error:  # of a default that does not fit
        _refuse(prog, str(error))
    return options


def _refuse(prog: str, said: str) -> NoReturn:
    print(f"{prog}: {one_line(said)}; see {prog} --help", file=sys.stderr)
    raise SystemExit(WRONG)


def _first_of(box: str) -> str:
    """What a box of tyro's says, in one line: its first part, and the option it thinks of."""
    lines = [line.strip(_FRAME).rstrip() for line in box.splitlines() if not line.startswith("╭")]
    rules = [k for k, line in enumerate(lines) if set(line) == {"─"}] or [len(lines)]
    first, rest = lines[: rules[0]], lines[rules[0] :]
    if first and first[0].startswith("Missing from"):
        names = re.findall(r"^│ {5}([-A-Z]\S*)", box, re.MULTILINE)  # deeper ones are their help
        return f"expected {', '.join(names[: len(first) - 1])}, got none"
    said = " ".join(first).replace("Unrecognized options:", "unknown").strip()
    meant = next((line.split()[0] for line in rest if line.startswith("--")), "")
    return f"{said}; did you mean {meant}?" if meant and said.startswith("unknown") else said


def _check(command: str, options: Mapping[str, Any]) -> None:
    """Make sure that a command's options by name can be, and its results be written. ConfigError
    for a number out of its range, an output that cannot be or is an input."""
    every = dict(_flat(options))
    for name, value in every.items():
        for number in value if isinstance(value, tuple) else (value,):
            if name in _LIMITS and type(number) in (int, float):  # a flag may be named so, too
                expect_between(name, number, *_LIMITS[name])
    out, files = every.get("out"), [every.get("json")]
    if out is not None and command in _OUT_IS_FILE:
        files.append(out)
    elif out is not None:
        expect_folder(out)
    read = ("model", "against", "parser", "images", "source", "contract", "sight", "translate")
    given = [every.get(name) or () for name in (*read, "look", "map")]
    inputs = [Path(path) for one in given for path in (one if isinstance(one, tuple) else (one,))]
    expect_writable(*files, inputs=inputs)


def _flat(options: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    for name, value in options.items():
        if dataclasses.is_dataclass(value) and not isinstance(value, type):
            yield from _flat({f.name: getattr(value, f.name) for f in dataclasses.fields(value)})
        else:
            yield name, value
