"""Runs tests in forks of a warm process, in a copy of the repository: a second or two for each."""

import contextlib
import gc
import importlib
import json
import os
import select
import shutil
import signal
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from types import CodeType, FrameType

import pytest

import tools
from tools.mutants.mutations import Mutant

_ROOT = Path(__file__).parent.parent.parent
_LEFT_BEHIND = shutil.ignore_patterns(".git", ".venv*", "runs", ".mypy_cache", ".ruff_cache")
_HEAVY = ("numpy", "cv2", "yaml", "zmq", "onnxruntime", "hypothesis.strategies", "mcap.writer",
          "numba", "torch", "gymnasium", "stable_baselines3", "pybullet", "onnx", "tyro", "rich",
          "matplotlib.pyplot", "torch.utils.tensorboard")  # fmt: skip
_MUTATED = ("robot", "localizer_node", "sim_pybullet", "trainer")
_copy = Path()  # this worker's own tree

Calls = dict[str, tuple[float, list[str]]]  # of each test: seconds, ``path:function`` called


def prepare(scratch: str) -> None:
    """Make this process a worker: its own copy of the tree, and what is slow to import loaded."""
    global _copy
    _copy = Path(tempfile.mkdtemp(dir=scratch)) / "tree"
    shutil.copytree(_ROOT, _copy, ignore=_LEFT_BEHIND, symlinks=True)
    data = os.environ.get("DUCKPILOT_DATA", _ROOT.parent / "shared" / "data")
    os.environ.update(DUCKPILOT_DATA=str(data), PYTHONPATH=str(_copy), PYTHONDONTWRITEBYTECODE="1",
                      OMP_NUM_THREADS="1", NUMBA_NUM_THREADS="1")  # fmt: skip
    os.chdir(_copy)
    sys.dont_write_bytecode = True
    sys.path[:] = [str(_copy), *(each for each in sys.path if Path(each).resolve() != _ROOT)]
    tools.__path__ = [str(_copy / "tools")]
    for name in [each for each in sys.modules if each.split(".")[0] in _MUTATED]:
        del sys.modules[name]  # the command line's own, from the tree that is not mutated
    for name in _HEAVY:
        with contextlib.suppress(ImportError):
            importlib.import_module(name)
    gc.freeze()


def cover(test_file: str, package: str) -> Calls:
    """What the tests of a file call in a package; under its own name, what serves all of them."""
    _fork([test_file, "-q"], _Recorder(test_file, package), 1800.0)
    return dict(json.loads(_told().read_text() or "{}"))


def try_mutant(mutant: Mutant, tests: list[str], limit_s: float) -> tuple[str, str]:
    """``killed``, ``survived`` or ``invalid``, and the test that killed."""
    target = _copy / mutant.path
    source, times = target.read_bytes(), target.stat()
    changed = mutant.apply(source)
    try:
        compile(changed, mutant.path, "exec")
    except SyntaxError:
        return "invalid", ""
    target.write_bytes(changed)  # a time of its own: Python takes no compiled file for it
    try:
        status = _fork([*tests, "-x", "-q"], _Witness(), limit_s)
    finally:
        target.write_bytes(source)
        os.utime(target, ns=(times.st_atime_ns, times.st_mtime_ns))
    if status is None:
        return "killed", f"not done after {limit_s:.0f} s"
    return ("killed", _told().read_text()) if status else ("survived", "")


def _told() -> Path:
    return _copy.parent / "told"


def _fork(arguments: list[str], plugin: object, limit_s: float) -> int | None:
    """pytest's exit status in a fork; None when it takes longer. No child of it outlives it."""
    _told().write_text("")
    if not (pid := os.fork()):
        os.setsid()
        os.dup2(os.open(_copy.parent / "output", os.O_WRONLY | os.O_CREAT | os.O_TRUNC), 1)
        os.dup2(1, 2)
        arguments = [*arguments, "-p", "no:cacheprovider", f"--basetemp={_copy.parent / 't'}"]
        try:
            os._exit(pytest.main(arguments, plugins=[plugin]))
        finally:
            os._exit(99)
    watched, poll = os.pidfd_open(pid), select.poll()
    poll.register(watched, select.POLLIN)
    ended = poll.poll(limit_s * 1000)
    os.close(watched)
    with contextlib.suppress(ProcessLookupError):
        os.killpg(pid, signal.SIGKILL)
    status = os.waitpid(pid, 0)[1]
    return os.waitstatus_to_exitcode(status) if ended else None


class _Witness:
    """Tells which test failed first."""

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.failed:
            _told().write_text(report.nodeid)

    def pytest_collectreport(self, report: pytest.CollectReport) -> None:
        if report.failed:
            _told().write_text(report.nodeid)


class _Recorder:
    """Notes which functions of the package each test calls, by the interpreter's own hook."""

    def __init__(self, test_file: str, package: str) -> None:
        self._file, self._inside = test_file, f"{_copy}/{package}/"
        self._seen: dict[int, CodeType] = {}
        self._tests: Calls = {}

    def _hook(self, frame: FrameType, event: str, _argument: object) -> None:
        if event == "call":
            self._seen[id(frame.f_code)] = frame.f_code

    def _take(self, test: str, seconds: float) -> None:
        """Book what was called since the last time on ``test``."""
        called = {
            f"{Path(code.co_filename).relative_to(_copy)}:{code.co_qualname}"
            for code in list(self._seen.values())
            if code.co_filename.startswith(self._inside)
        }
        self._seen.clear()
        before_s, before = self._tests.get(test, (0.0, []))
        self._tests[test] = (before_s + seconds, sorted(called.union(before)))

    @pytest.hookimpl(wrapper=True)
    def pytest_collection(self) -> Iterator[None]:
        threading.setprofile(self._hook)
        sys.setprofile(self._hook)
        return (yield)

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_call(self, item: pytest.Item) -> Iterator[None]:
        self._take(self._file, 0.0)  # imports and fixtures serve the whole file
        began = time.perf_counter()
        try:
            return (yield)
        finally:
            self._take(item.nodeid.split("[")[0], time.perf_counter() - began)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.failed:  # a test that fails by itself kills nothing
            self._tests[report.nodeid.split("[")[0]] = (-1.0, [])

    def pytest_sessionfinish(self) -> None:
        self._take(self._file, 0.0)
        _told().write_text(json.dumps(self._tests))
