"""The mutation tool: what it changes, and that its lists fit the source."""

import subprocess
import sys
from pathlib import Path
from textwrap import dedent

import pytest

from tools.mutants.__main__ import ROOT, TESTS, all_mutants, choose_tests, explained, named_mutants
from tools.mutants.mutations import Mutant, mutants_of

SOURCE = dedent(
    '''
    """Words."""
    LIMIT = 0.5  # µ

    class Gate:
        """Words."""

        def look(self, age: int = 0) -> bool:
            """Words."""
            log.info("age %d", 1 + 1)
            if not 0 <= age and self.open:
                raise ValueError(f"{age + 1} is old")
            self.seen = shift(age, 2 * age)
            return age is None
    '''
).encode()


def test_changes_are_these_and_leave_words_alone() -> None:
    changes = {(mutant.scope, mutant.before, mutant.after) for mutant in mutants_of("x.py", SOURCE)}
    look = "Gate.look"
    assert changes == {
        ("", "0.5", "1.0"),
        (look, "0", "1"),
        (look, "not 0 <= age and self.open", "(not 0 <= age or self.open)"),
        (look, "not 0 <= age", "(0 <= age)"),
        (look, "0 <= age", "(0 < age)"),
        (look, 'raise ValueError(f"{age + 1} is old")', "pass"),
        (look, "self.seen = shift(age, 2 * age)", "pass"),
        (look, "shift(age, 2 * age)", "shift(2 * age, age)"),
        (look, "2 * age", "(2 / age)"),
        (look, "2", "3"),
        (look, "return age is None", "return None"),
        (look, "age is None", "(age is not None)"),
    }


def test_every_mutant_is_another_program_with_a_name_of_its_own() -> None:
    mutants = mutants_of("x.py", SOURCE)
    changed = {mutant.apply(SOURCE) for mutant in mutants}
    assert len(changed) == len(mutants) == len({mutant.name for mutant in mutants})
    for source in changed:
        compile(source, "x.py", "exec")
        assert "µ".encode() in source


def test_the_likeliest_tests_come_first() -> None:
    mutant = Mutant("robot/a.py", "f", 1, "1", "2", 0, 1)
    calls = {
        "tests/test_a.py": (0.0, []),
        "tests/test_a.py::test_slow": (3.0, ["robot/a.py:f"]),
        "tests/test_a.py::test_other": (0.1, []),
        "tests/test_b.py": (0.0, []),
        "tests/test_b.py::test_quick": (1.0, ["robot/a.py:f"]),
        "tests/test_b.py::test_unrelated": (1.0, ["robot/b.py:f"]),
        "tests/test_b.py::test_broken": (-1.0, ["robot/a.py:f"]),
    }
    tests, seconds = choose_tests(mutant, calls)
    assert [test.split("::")[1] for test in tests] == ["test_quick", "test_slow", "test_other"]
    assert seconds == pytest.approx(4.1)


def test_each_named_fault_still_fits_the_source() -> None:
    named = named_mutants()  # raises where a text is gone
    assert named
    assert all((ROOT / test.split("::")[0]).exists() for _, _, tests in named for test in tests)


def test_each_explanation_is_of_a_mutant_that_exists() -> None:
    names = {mutant.name for package in TESTS for mutant in all_mutants(package)}
    gone = set(explained()) - names
    assert not gone, "remove them from tests/mutants/explained.toml: their lines have changed"


def test_a_worker_tries_its_own_copy_and_not_what_the_command_line_has_loaded(
    tmp_path: Path,
) -> None:
    code = (
        "import sys, tools.mutants.__main__\n"
        "from tools.mutants import trial\n"
        "trial._HEAVY = ()\n"
        "trial.prepare(sys.argv[1])\n"
        "import robot.errors, robot.navigation.navigator\n"
        "print(robot.errors.__file__, robot.navigation.navigator.__file__)\n"
    )
    command = [sys.executable, "-c", code, str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    files = done.stdout.split()
    assert len(files) == 2
    assert all(file.startswith(str(tmp_path)) for file in files)
