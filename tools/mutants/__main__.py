"""Which changes to the source would no test notice?"""

import argparse
import hashlib
import json
import tempfile
import tomllib
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path

from tools.mutants import trial
from tools.mutants.mutations import Mutant, mutants_of

ROOT = Path(__file__).parent.parent.parent
EXPLAINED = ROOT / "tests" / "mutants" / "explained.toml"
NAMED = ROOT / "tests" / "mutants" / "named.toml"
OUT = ROOT / "runs" / "mutants"
TESTS = {
    "robot/safety": ["tests/robot/safety", "tests/robot/runtime"],
    "robot/hat": ["tests/robot/hat", "tests/sim_pybullet/virtual"],
    "robot/link": ["tests/robot/link", "tests/robot/runtime/test_remote.py"],
    "robot/navigation": ["tests/robot/navigation"],
    "robot/inference": ["tests/robot/inference"],
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
_TESTS_S = 60.0  # of tests for one mutant at most, the likeliest first


def main() -> None:
    """Try the mutants that were not tried before, then print the table."""
    parser = argparse.ArgumentParser(prog="python -m tools.mutants", description=__doc__)
    parser.add_argument("packages", nargs="*", help=f"of {', '.join(TESTS)} (default: all)")
    parser.add_argument("--sample", type=int, help="only so many mutants of each package")
    parser.add_argument("--seed", type=int, default=0, help="which sample (default: 0)")
    parser.add_argument("--workers", type=int, default=2, help="processes (default: 2)")
    parser.add_argument("--again", action="store_true", help="try the survivors once more")
    parser.add_argument(
        "--named", nargs="?", const="", metavar="PATH", help="those of tests/mutants/named.toml"
    )
    parser.add_argument("--report", action="store_true", help="only the table of what was tried")
    args = parser.parse_args()
    if unknown := sorted(set(args.packages) - set(TESTS)):
        parser.error(f"expected packages of {', '.join(TESTS)}; got {', '.join(unknown)}")
    packages = args.packages or list(TESTS)
    if args.report:
        return report(packages)
    OUT.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="mutants-") as scratch:
        pool = ProcessPoolExecutor(args.workers, initializer=trial.prepare, initargs=(scratch,))
        with pool:
            if args.named is not None:
                raise SystemExit(try_named(pool, args.named))
            for package in packages:
                mutants = sorted(all_mutants(package), key=lambda each: _lot(args.seed, each.name))
                try_package(pool, package, mutants[: args.sample], args.again)
    report(packages)


def all_mutants(package: str) -> list[Mutant]:
    """Every mutant of a package."""
    paths = sorted((ROOT / package).glob("*.py"))
    return [m for path in paths for m in mutants_of(str(path.relative_to(ROOT)), path.read_bytes())]


def named_mutants() -> list[tuple[Mutant, str, list[str]]]:
    """The faults that must be noticed: mutant, what it is, the tests that notice it.

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
        found.append((mutant, entry["what"], entry["tests"]))
    return found


def explained() -> dict[str, str]:
    """Why each survivor that may live does no harm, by its name."""
    return {each["name"]: each["why"] for each in tomllib.loads(EXPLAINED.read_text())["survivor"]}


def try_named(pool: ProcessPoolExecutor, path: str) -> int:
    """How many of the named mutants survive, among those of files whose path begins so."""
    tries = [
        (what, pool.submit(trial.try_mutant, mutant, tests, 900.0))
        for mutant, what, tests in named_mutants()
        if mutant.path.startswith(path)
    ]
    outcomes = []
    for what, future in tries:
        outcome, by = future.result()
        outcomes.append(outcome)
        print(f"{outcome:9} {what}  {by}", flush=True)
    return len(outcomes) - outcomes.count("killed")


def try_package(
    pool: ProcessPoolExecutor, package: str, mutants: list[Mutant], again: bool
) -> None:
    """Try what was not tried yet; each outcome is a line of runs/mutants/results.jsonl."""
    done = _results()
    open_ones = [m for m in mutants if done.get(m.name) not in ("killed", "invalid")]
    if not again:
        open_ones = [m for m in open_ones if m.name not in done]
    calls = cover(pool, package) if open_ones else {}
    tries = {}
    for mutant in open_ones:
        tests, seconds = choose_tests(mutant, calls)
        limit = 60.0 + 3 * seconds  # numba may have to compile again
        tries[pool.submit(trial.try_mutant, mutant, tests, limit)] = mutant
    with (OUT / "results.jsonl").open("a") as file:
        for count, future in enumerate(as_completed(tries), start=1):
            mutant, (outcome, by) = tries[future], future.result()
            line = {"name": mutant.name, "line": mutant.line, "outcome": outcome, "by": by}
            print(json.dumps(line), file=file, flush=True)
            print(f"{package} {count}/{len(tries)} {outcome:9} {mutant.name}  {by}", flush=True)


def cover(pool: ProcessPoolExecutor, package: str) -> trial.Calls:
    """What each test of a package calls, remembered in runs/mutants/ while its file is the same."""
    known = OUT / "calls.json"
    remembered = json.loads(known.read_text()) if known.exists() else {}
    paths = {path for each in TESTS[package] for path in _test_files(ROOT / each)}
    keys = {
        f"{package} {path.relative_to(ROOT)} {_lot(0, path.read_text())}": path for path in paths
    }
    tries = {
        pool.submit(trial.cover, str(path.relative_to(ROOT)), package): key
        for key, path in keys.items()
        if key not in remembered
    }
    for future in as_completed(tries):
        remembered[tries[future]] = future.result()
        known.write_text(json.dumps(remembered))
        print(f"recorded {tries[future]}", flush=True)
    return {test: call for key in keys for test, call in remembered[key].items()}


def choose_tests(mutant: Mutant, calls: trial.Calls) -> tuple[list[str], float]:
    """The tests for a mutant, likeliest and fastest first, and the seconds that they take."""
    stem = f"/test_{Path(mutant.path).stem}.py"
    scope = f"{mutant.path}:{mutant.scope}"
    ranked = []
    for test, (seconds, called) in calls.items():
        shared = calls.get(test.split("::")[0], (0.0, []))[1]  # by imports and fixtures
        in_module = any(each.startswith(f"{mutant.path}:") for each in called)
        imported = not mutant.scope and f"{mutant.path}:<module>" in shared
        marks = (scope in called, stem in test, in_module, scope in shared, imported)
        if "::" in test and seconds >= 0 and any(marks):
            ranked.append((marks.index(True), seconds, test))
    tests: list[str] = []
    total = 0.0
    for _, seconds, test in sorted(ranked):
        if total + seconds <= _TESTS_S or not tests:
            tests.append(test)
            total += seconds
    return tests, total


def report(packages: Iterable[str]) -> None:
    """Print the survivors that nobody explained, and the table."""
    done, excused, rows = _results(), explained(), []
    for package in packages:
        names = [mutant.name for mutant in all_mutants(package)]
        killed = sum(done.get(name) == "killed" for name in names)
        survivors = [name for name in names if done.get(name) == "survived"]
        known = sum(name in excused for name in survivors)
        rows.append((package, len(names), killed + len(survivors), killed, len(survivors), known))
        for name in survivors:
            if name not in excused:
                print(f"survived: {name}")
    rows.append(("in all", *(sum(column) for column in list(zip(*rows, strict=True))[1:])))
    print("| package | mutants | tried | killed | survived | of these explained | survived, % |")
    print("|---|---|---|---|---|---|---|")
    for row in rows:
        print("|", *(f"{each} |" for each in row), f"{100 * row[4] / max(row[2], 1):.1f} |")


def _results() -> dict[str, str]:
    file = OUT / "results.jsonl"
    lines = map(json.loads, file.read_text().splitlines() if file.exists() else [])
    return {line["name"]: line["outcome"] for line in lines}


def _test_files(path: Path) -> list[Path]:
    return [path] if path.is_file() else sorted(path.rglob("test_*.py"))


def _lot(seed: int, text: str) -> str:
    return hashlib.sha1(f"{seed} {text}".encode()).hexdigest()


if __name__ == "__main__":
    main()
