"""The documents: short enough to be read, and every link in them leads somewhere."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
PAGES = sorted([ROOT / "README.md", *DOCS.rglob("*.md")])
APPENDIX = "lab-log.md"

MOST_WORDS = 22_000
FENCES = re.compile(r"^(```|~~~).*?^\1", re.MULTILINE | re.DOTALL)
LINKS = re.compile(r"\]\(([^()\s]+(?:\([^()\s]*\))?)\)")
IMAGES = re.compile(r"""<(?:img|source)[^>]*?src(?:set)?=["']([^"']+)""")


def prose(page: Path) -> str:
    """The page without its blocks of code."""
    return FENCES.sub("", page.read_text(encoding="utf-8"))


def slug(heading: str) -> str:
    """The anchor that GitHub and Python-Markdown both give a heading."""
    text = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading)
    text = re.sub(r"[^\w\s-]", "", text).strip().lower()
    return re.sub(r"[\s-]+", "-", text)


def anchors(page: Path) -> set[str]:
    return {slug(found) for found in re.findall(r"^#+ (.+?)\s*$", prose(page), re.MULTILINE)}


def broken(page: Path) -> list[str]:
    """Links of a page that lead nowhere: files that are not there, headings that no page has."""
    wrong = []
    for link in LINKS.findall(prose(page)) + IMAGES.findall(prose(page)):
        if re.match(r"[a-z]+:", link):
            continue
        path, _, anchor = link.partition("#")
        target = (page.parent / path).resolve() if path else page
        left = page.parent == DOCS and DOCS not in target.parents  # the site has no such page
        if left or not target.exists() or (anchor and anchor not in anchors(target)):
            wrong.append(link)
    return wrong


def words(page: Path) -> int:
    """Words and figures of a page, code included; bars and rules of tables are none."""
    return sum(
        any(letter.isalnum() for letter in word)
        for word in page.read_text(encoding="utf-8").split()
    )


def test_the_documents_are_short_enough_to_be_read() -> None:
    counted = {page.name: words(page) for page in PAGES if page.name != APPENDIX}
    assert sum(counted.values()) <= MOST_WORDS, sorted(counted.items(), key=lambda one: -one[1])


def test_the_site_shows_every_page() -> None:
    shown = set(
        re.findall(r": ([\w-]+\.md)$", (ROOT / "mkdocs.yml").read_text("utf-8"), re.MULTILINE)
    )
    assert shown == {page.name for page in DOCS.rglob("*.md")}


def test_a_broken_link_is_noticed(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text(
        "# One `two`\n[a](#one-two) [b](#three) [c](gone.md) [d](page.md#one-two) "
        "[e](https://example.org)\n```\n[f](code.md)\n```\n"
    )
    assert broken(page) == ["#three", "gone.md"]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_link_and_anchor_leads_somewhere(page: Path) -> None:
    assert broken(page) == []
    assert not re.search(r"\]\([^)\n]*$", prose(page), re.MULTILINE), "a link that does not end"


def test_programs_that_the_documents_name_exist() -> None:
    pattern = r"python[\d.]* -m ((?:robot|trainer|localizer_node|tools|tests)\b(?:\.\w+)*)"
    named: dict[str, str] = {}
    for page in [*PAGES, *(ROOT / "robot" / "models").glob("*.md")]:
        for module in re.findall(pattern, page.read_text(encoding="utf-8")):
            named[module] = page.name
    assert len(named) > 10
    paths = {module: ROOT.joinpath(*module.split(".")) for module in named}
    gone = [
        f"{module} in {named[module]}"
        for module, path in paths.items()
        if not (path.with_suffix(".py").exists() or (path / "__main__.py").exists())
    ]
    assert gone == []


def test_code_and_cards_cite_pages_that_exist() -> None:
    cited: dict[str, Path] = {}
    for folder in ("robot", "trainer", "sim_pybullet", "localizer_node", "tools", "examples"):
        for end in ("py", "md", "yaml"):
            for file in (ROOT / folder).rglob(f"*.{end}"):
                for name in re.findall(r"\bdocs/[\w./-]+?\.md\b", file.read_text(encoding="utf-8")):
                    cited[name] = file
    assert len(cited) > 5
    assert [str(file) for name, file in cited.items() if not (ROOT / name).exists()] == []
