"""What every command line shares: wrong input ends in one line on stderr and exit status 2."""

import argparse
import difflib
import errno
import math
import os
import sys
from typing import Any, Callable, Iterator, NoReturn, Optional, Tuple

from robot.errors import DuckpilotError, HardwareError, nearest

WRONG, FAILED, INTERRUPTED = 2, 1, 130
_MOST = 240  # characters of what a person typed that are told again

# What an installation lacks that was made without an extra.
_EXTRAS = {
    "trainer": "torch stable_baselines3 gymnasium pybullet pybullet_data numba onnx tyro "
    "tensorboard matplotlib jinja2 imageio_ffmpeg rich",
    "monitor": "fastapi uvicorn pydantic starlette",
    "scale": "ray",
    "lerobot": "pyarrow",
    "": "numpy cv2 onnxruntime yaml smbus2 zmq mcap zstandard",
}
_EXTRA_OF = {module: extra for extra, modules in _EXTRAS.items() for module in modules.split()}
_WRONG_PATH = (errno.ENOENT, errno.EEXIST, errno.ENOTDIR, errno.EISDIR, errno.EACCES, errno.EPERM)


def answer(program: str, work: Callable[[], Optional[int]]) -> int:
    """Do a command's work; its exit status.

    What a person can mend ends in one line on stderr: status 2 for wrong input, 1 for a device or
    a disk that fails, 130 for Ctrl-C. Whatever else is raised is an error of ours, and is raised.
    """
    try:
        return int(work() or 0)
    except (Exception, KeyboardInterrupt) as error:
        line, status = _told(error)
        if line is None:
            raise
        if line:
            print(f"{program}: {one_line(line)}", file=sys.stderr)
        return status


def spoken(program: str) -> str:
    """``program`` as errors begin with it: without ``python -m``."""
    return program[len("python -m ") :] if program.startswith("python -m ") else program


def one_line(text: str) -> str:
    """The text without line breaks or control characters."""
    return " ".join("".join(c if c.isprintable() else " " for c in text).split())


def _told(error: BaseException) -> Tuple[Optional[str], int]:
    """The line and the exit status of what a person can mend; no line for anything else."""
    if isinstance(error, KeyboardInterrupt):
        return "stopped by Ctrl-C", INTERRUPTED
    if isinstance(error, DuckpilotError):
        return str(error), WRONG
    if isinstance(error, HardwareError):
        return str(error), FAILED
    if isinstance(error, BrokenPipeError):  # whoever read the output has had enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return "", FAILED
    if isinstance(error, OSError):  # a path that cannot be written is wrong input, a full disk not
        what = error.strerror or str(error)
        line = what if error.filename is None else f"{error.filename}: {what}"
        return line, WRONG if error.errno in _WRONG_PATH else FAILED
    extra = _EXTRA_OF.get(str(getattr(error, "name", "")).split(".")[0])
    if not isinstance(error, ModuleNotFoundError) or extra is None:
        return None, FAILED
    package = f"'.[{extra}]'" if extra else "."
    told = f"expected the package {error.name}, found none; in a clone pip install {package}"
    return f"{told} brings it", WRONG


class OneLineParser(argparse.ArgumentParser):
    """Tells what is wrong in one line, without the usage before it, and what would be right."""

    def error(self, message: str) -> NoReturn:
        """Exit with status 2."""
        told = one_line(message)
        told = told if len(told) <= 2 * _MOST else told[: 2 * _MOST] + " …"
        self.exit(WRONG, f"{self.prog}: {told}; see {self.prog} --help\n")

    def parse_args(self, args: Any = None, namespace: Any = None) -> Any:
        """As argparse, but an unknown option comes with the nearest known one."""
        options, unknown = self.parse_known_args(args, namespace)
        if unknown:
            known = sorted(set(_option_names(self)))
            close = difflib.get_close_matches(unknown[0].split("=")[0], known, n=1)
            hint = f"; did you mean {close[0]}?" if close else ""
            self.error(f"unknown {' '.join(unknown)[:_MOST]}{hint}")
        return options

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        if action.choices is not None and value not in action.choices:
            valid = nearest(str(value), [str(choice) for choice in action.choices])
            raise argparse.ArgumentError(action, f"unknown {str(value)[:_MOST]!r}; {valid}")


def _option_names(parser: argparse.ArgumentParser) -> Iterator[str]:
    for action in parser._actions:
        yield from action.option_strings
        if isinstance(action, argparse._SubParsersAction):
            for inner in action.choices.values():
                yield from _option_names(inner)


def whole(low: int, high: int) -> Callable[[str], int]:
    """For ``type=``: a whole number from ``low`` to ``high``."""
    return _bounded(int, low, high, f"a whole number from {low} to {high}")


def number(low: float, high: float) -> Callable[[str], float]:
    """For ``type=``: a number from ``low`` to ``high``; never NaN."""
    return _bounded(float, low, high, f"a number from {low:g} to {high:g}")


def _bounded(kind: Callable[[str], Any], low: float, high: float, expected: str) -> Any:
    def read(text: str) -> Any:
        try:
            value = kind(text)
        except ValueError:
            value = math.nan
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(f"expected {expected}, got {text[:_MOST]!r}")
        return value

    return read


def pair(example: str) -> Callable[[str], Tuple[float, float]]:
    """For ``type=``: two finite numbers with a comma between them, as in the example."""

    def read(text: str) -> Tuple[float, float]:
        try:
            one, other = (float(word) for word in text.split(","))
        except ValueError:
            one = other = math.nan
        if not math.isfinite(one + other):
            raise argparse.ArgumentTypeError(f"expected {example}, got {text[:_MOST]!r}")
        return one, other

    return read
