"""The house style that a machine can hold: small files, small functions, annotated arguments."""

import ast
import statistics
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PACKAGES = ("robot", "trainer", "sim_pybullet", "localizer_node", "tools")
FILES = sorted(path for package in PACKAGES for path in (ROOT / package).rglob("*.py"))
MAX_FILE_LINES = 350
MAX_FUNCTION_LINES = 50
MAX_LINES = 40_000


def lines_of(path: Path) -> int:
    return len(path.read_text(encoding="utf-8").splitlines())


def functions(path: Path) -> list[ast.FunctionDef | ast.AsyncFunctionDef]:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    return [n for n in ast.walk(tree) if isinstance(n, (ast.FunctionDef, ast.AsyncFunctionDef))]


def body_lines(node: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    docstring = ast.get_docstring(node, clean=False)
    end = node.end_lineno or node.lineno
    return end - node.lineno + 1 - (docstring.count("\n") + 1 if docstring else 0)


@pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.relative_to(ROOT)))
def test_file_is_small(path: Path) -> None:
    assert lines_of(path) <= MAX_FILE_LINES
    long = {n.name: body_lines(n) for n in functions(path) if body_lines(n) > MAX_FUNCTION_LINES}
    assert not long, f"functions over {MAX_FUNCTION_LINES} lines: {long}"


def test_the_program_is_small() -> None:
    lines = sum(lines_of(path) for path in [*FILES, *(ROOT / "examples").rglob("*.py")])
    assert lines <= MAX_LINES


@pytest.mark.parametrize("package", PACKAGES)
def test_files_and_functions_are_mostly_short(package: str) -> None:
    files = [path for path in FILES if path.is_relative_to(ROOT / package)]
    sizes = sorted(body_lines(node) for path in files for node in functions(path))
    assert statistics.median(map(lines_of, files)) <= 110
    assert sizes[int(0.9 * len(sizes))] <= 20
