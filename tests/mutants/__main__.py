"""Which changes to the source would no test notice?"""

import argparse
import contextlib
import hashlib
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path
from queue import SimpleQueue

import pytest

from tests.mutants.mutations import Mutant, mutants_of

ROOT = Path(__file__).parents[2]
EXPLAINED, NAMED = (
    Path(__file__).with_name("explained.toml"),
    Path(__file__).with_name("named.toml"),
)
RESULTS = ROOT / "runs" / "mutants" / "results.jsonl"
TESTS = {
    "robot/safety": ["tests/robot/safety", "tests/robot/runtime"],
    "robot/hat": [
        "tests/robot/hat",
        "tests/robot/test_data_path.py",
        "tests/sim_pybullet/virtual",
        "tests/tools/test_loop_parts.py",
    ],
    "robot/link": ["tests/robot/link", "tests/robot/runtime/test_remote.py"],
    "robot/navigation": ["tests/robot/navigation"],
    "robot/inference": ["tests/robot/inference"],
    "robot/runtime": ["tests/robot/runtime", "tests/robot/safety"],
    "robot/recording": ["tests/robot/recording"],
    "robot/vision": ["tests/robot/vision"],
    "localizer_node": ["tests/localizer_node"],
    "sim_pybullet/tasks": [
        "tests/sim_pybullet/test_lane_keeping.py",
        "tests/sim_pybullet/test_navigation.py",
        "tests/sim_pybullet/test_manoeuvres.py",
        "tests/sim_pybullet/test_track_racing.py",
    ],
    "sim_pybullet/sensing": ["tests/sim_pybullet/sensing"],
    "trainer/algorithms": ["tests/trainer/learners", "tests/trainer/test_algorithms.py"],
    "trainer/learners": ["tests/trainer/learners"],
    "trainer/transfer": ["tests/trainer/transfer"],
    "trainer/judging": ["tests/trainer/judging"],
}  # the tests that belong to each package
LIMIT_S = 900.0  # tests that take longer have noticed
_LEFT_BEHIND = shutil.ignore_patterns(".git", ".venv*", "runs", ".mypy_cache", ".ruff_cache")


def main() -> None:
    """Try the mutants that were not tried before, then print the table."""
    parser = argparse.ArgumentParser(prog="python -m tests.mutants", description=__doc__)
    parser.add_argument("packages", nargs="*", help=f"of {', '.join(TESTS)} (default: all)")
    parser.add_argument("--sample", type=int, help="only so many mutants of each package")
    parser.add_argument("--seed", type=int, default=0, help="which sample (default: 0)")
    parser.add_argument("--workers", type=int, default=2, help="at once (default: 2)")
    parser.add_argument("--again", action="store_true", help="try the survivors once more")
    parser.add_argument("--named", action="store_true", help="those of tests/mutants/named.toml")
    args = parser.parse_args()
    if unknown := sorted(set(args.packages) - set(TESTS)):
        parser.error(f"expected packages of {', '.join(TESTS)}; got {', '.join(unknown)}")
    packages = args.packages or list(TESTS)
    if args.named:
        outcomes = [outcome for _, outcome in try_all(named_mutants(), args.workers)]
        raise SystemExit(len(outcomes) - outcomes.count("killed"))
    done = results()
    for package in packages:
        mutants = sorted(all_mutants(package), key=lambda each: _lot(args.seed, each.name))
        settled = ("killed", "invalid") if args.again else ("killed", "invalid", "survived")
        new = [m for m in mutants[: args.sample] if done.get(m.name) not in settled]
        if new:
            expect_passing(package, new[0].path)
        for mutant, outcome in try_all([(m, likely_tests(m, package)) for m in new], args.workers):
            RESULTS.parent.mkdir(parents=True, exist_ok=True)
            with RESULTS.open("a") as file:
                print(json.dumps({"name": mutant.name, "outcome": outcome}), file=file)
    report(packages)


def expect_passing(package: str, path: str) -> None:
    """Exit unless the package's tests pass while nothing is changed: else they would notice all."""
    same = Mutant(path, "", 0, "nothing", "", 0, 0)
    if [outcome for _, outcome in try_all([(same, likely_tests(same, package))], 1)] != [
        "survived"
    ]:
        raise SystemExit(f"{package}: expected its tests to pass unchanged, they fail")


def all_mutants(package: str) -> list[Mutant]:
    """Every mutant of a package."""
    paths = sorted((ROOT / package).glob("*.py"))
    return [m for path in paths for m in mutants_of(str(path.relative_to(ROOT)), path.read_bytes())]


def named_mutants() -> list[tuple[Mutant, list[str]]]:
    """The faults that must be noticed, with the tests that notice them.

    Raises ValueError where a text to be replaced does not stand in its file exactly once.
    """
    found = []
    for entry in tomllib.loads(NAMED.read_text())["mutant"]:
        source = (ROOT / entry["path"]).read_text()
        if (count := source.count(entry["before"])) != 1:
            raise ValueError(f"{entry['path']}: expected {entry['before']!r} once, found {count}")
        start = len(source[: source.index(entry["before"])].encode())
        end = start + len(entry["before"].encode())
        mutant = Mutant(entry["path"], "", 0, entry["before"], entry["after"], start, end)
        found.append((mutant, entry["tests"]))
    return found


def explained() -> dict[str, str]:
    """Why each survivor that may live does no harm, by its name."""
    return {each["name"]: each["why"] for each in tomllib.loads(EXPLAINED.read_text())["survivor"]}


def likely_tests(mutant: Mutant, package: str) -> list[str]:
    """The package's test files, those named like the mutant's module first."""
    paths = [path for each in TESTS[package] for path in _test_files(ROOT / each)]
    name = f"test_{Path(mutant.path).stem}.py"
    paths.sort(key=lambda path: (path.name != name, path))
    return ["-m", "not slow", *(str(path.relative_to(ROOT)) for path in paths)]


def try_all(tries: list[tuple[Mutant, list[str]]], workers: int) -> Iterator[tuple[Mutant, str]]:
    """Each mutant with its outcome, as it is known; every worker has a tree of its own."""
    with tempfile.TemporaryDirectory(prefix="mutants-") as scratch:
        trees: SimpleQueue[Path] = SimpleQueue()
        for number in range(min(workers, len(tries))):
            tree = Path(scratch) / str(number) / ROOT.name
            shutil.copytree(ROOT, tree, ignore=_LEFT_BEHIND, symlinks=True)
            trees.put(tree)

        def attempt(mutant: Mutant, tests: list[str]) -> tuple[str, str]:
            tree = trees.get()
            try:
                return try_mutant(tree, mutant, tests)
            finally:
                trees.put(tree)

        with ThreadPoolExecutor(workers) as pool:
            futures = {pool.submit(attempt, *each): each[0] for each in tries}
            for count, future in enumerate(as_completed(futures), start=1):
                mutant, (outcome, by) = futures[future], future.result()
                print(f"{count}/{len(tries)} {outcome:9} {mutant.name}  {by}", flush=True)
                yield mutant, outcome


def try_mutant(tree: Path, mutant: Mutant, tests: list[str]) -> tuple[str, str]:
    """``killed``, ``survived`` or ``invalid``, and the test that killed."""
    target = tree / mutant.path
    source = target.read_bytes()
    changed = mutant.apply(source)
    try:
        compile(changed, mutant.path, "exec")
    except SyntaxError:
        return "invalid", ""
    target.write_bytes(changed)
    try:
        status, told = run_tests(tree, tests)
    finally:
        target.write_bytes(source)
    failed = re.search(r"^(?:FAILED|ERROR) (\S+)", told, re.MULTILINE)
    if status in (0, pytest.ExitCode.NO_TESTS_COLLECTED):
        return "survived", ""
    return "killed", failed[1] if failed else told[-100:]


def run_tests(tree: Path, tests: list[str]) -> tuple[int, str]:
    """pytest's exit status and what it says; no child of it outlives it."""
    data = os.environ.get("DUCKPILOT_DATA", str(ROOT.parent / "shared" / "data"))
    own = {"DUCKPILOT_DATA": data, "PYTHONPATH": str(tree), "PYTHONDONTWRITEBYTECODE": "1"}
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider"]
    program = subprocess.Popen(
        [*command, f"--basetemp={tree.parent / 'temporary'}", *tests],
        cwd=tree,
        env={**os.environ, **own, "OMP_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    )
    try:
        told, _ = program.communicate(timeout=LIMIT_S)
    except subprocess.TimeoutExpired:
        told = f"not done after {LIMIT_S:.0f} s"
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(program.pid, signal.SIGKILL)
    return program.wait(), told


def report(packages: Iterable[str]) -> None:
    """Print the survivors that nobody explained, and the table."""
    done, excused, rows = results(), explained(), []
    for package in packages:
        names = [mutant.name for mutant in all_mutants(package)]
        killed = sum(done.get(name) == "killed" for name in names)
        survivors = [name for name in names if done.get(name) == "survived"]
        known = sum(name in excused for name in survivors)
        rows.append((package, len(names), killed + len(survivors), killed, len(survivors), known))
        for name in survivors:
            if name not in excused:
                print(f"survived: {name}")
    print("| package | mutants | tried | killed | survived | of these explained |")
    print("|---|---|---|---|---|---|")
    for row in rows:
        print("|", *(f"{each} |" for each in row))


def results() -> dict[str, str]:
    """The outcomes so far, by the mutants' names."""
    lines = map(json.loads, RESULTS.read_text().splitlines() if RESULTS.exists() else [])
    return {line["name"]: line["outcome"] for line in lines}


def _test_files(path: Path) -> list[Path]:
    return [path] if path.is_file() else sorted(path.rglob("test_*.py"))


def _lot(seed: int, text: str) -> str:
    return hashlib.sha1(f"{seed} {text}".encode()).hexdigest()


if __name__ == "__main__":
    main()
