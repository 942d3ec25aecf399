"""The mutation tool: what it changes, and that its lists fit the source."""

import contextlib
from pathlib import Path
from textwrap import dedent

import pytest

from tests.mutants.__main__ import (
    ROOT,
    TESTS,
    all_mutants,
    expect_passing,
    explained,
    likely_tests,
    named_mutants,
    try_mutant,
)
from tests.mutants.mutations import Mutant, mutants_of

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
    tests = likely_tests(
        Mutant("robot/safety/wheel_limits.py", "f", 1, "1", "2", 0, 1), "robot/safety"
    )
    assert tests[2] == "tests/robot/safety/test_wheel_limits.py"
    assert "tests/robot/runtime/test_loop.py" in tests


TREE = {
    "source.py": "def double(x):\n    return x * 2\n",
    "test_source.py": "from source import double\n\ndef test_it():\n    assert double(3) == 6\n",
}


@pytest.mark.parametrize(
    ("before", "after", "outcome"),
    [("x * 2", "x / 2", "killed"), ("x * 2", "2 * x", "survived"), ("x * 2", "x x", "invalid")],
)
def test_a_mutant_is_killed_by_the_test_that_fails_and_leaves_nothing(
    tmp_path: Path, before: str, after: str, outcome: str
) -> None:
    for name, text in TREE.items():
        (tmp_path / name).write_text(text)
    start = TREE["source.py"].index(before)
    mutant = Mutant("source.py", "", 2, before, after, start, start + len(before))
    by = "test_source.py::test_it" if outcome == "killed" else ""
    assert try_mutant(tmp_path, mutant, ["test_source.py"]) == (outcome, by)
    assert (tmp_path / "source.py").read_text() == TREE["source.py"]


def test_each_named_fault_still_fits_the_source() -> None:
    named = named_mutants()  # raises where a text is gone
    assert named
    assert all((ROOT / test.split("::")[0]).exists() for _, tests in named for test in tests)


def test_each_explanation_is_of_a_mutant_that_exists() -> None:
    names = {mutant.name for package in TESTS for mutant in all_mutants(package)}
    gone = set(explained()) - names
    assert not gone, "remove them from tests/mutants/explained.toml: their lines have changed"


@pytest.mark.parametrize(("double", "passes"), [("x * 2", True), ("x * 3", False)])
def test_nothing_is_tried_with_tests_that_fail_anyhow(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, double: str, passes: bool
) -> None:
    for name, text in TREE.items():
        (tmp_path / name).write_text(text.replace("x * 2", double))
    monkeypatch.setattr("tests.mutants.__main__.ROOT", tmp_path)
    monkeypatch.setitem(TESTS, "here", ["test_source.py"])
    with contextlib.nullcontext() if passes else pytest.raises(SystemExit, match="they fail"):
        expect_passing("here", "source.py")
