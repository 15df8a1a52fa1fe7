"""Pages that are made from the code say what the code says."""

from __future__ import annotations

import runpy
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SCRIPTS = ROOT / "scripts"
NAMES = (
    "docs/architecture.md", "docs/board-messages.md", "docs/commands.md",
    "docs/faults.md", "docs/field-file.md", "docs/files.md", "docs/hazards.md",
    "docs/index.md", "docs/mission.md", "docs/original.md", "docs/presets.md", "docs/python.md",
    "docs/settings.md", "docs/results/original.csv", "docs/topics.md", "llms.txt",
)  # fmt: skip
OF_TEXTS = pytest.param("docs/facts.md", marks=pytest.mark.wording)


@pytest.fixture(scope="module")
def pages() -> dict[str, str]:
    before = list(sys.path)
    sys.path.insert(0, str(SCRIPTS))
    try:
        made = runpy.run_path(str(SCRIPTS / "write_pages.py"))["PAGES"]
        return {name: make() for name, make in made.items()}
    finally:
        sys.path[:] = before


def test_every_page_that_can_be_made_is_checked_here(pages: dict[str, str]) -> None:
    assert set(pages) == {*NAMES, *OF_TEXTS.values}


@pytest.mark.parametrize("name", [*NAMES, OF_TEXTS])
def test_a_page_is_as_the_code_makes_it(name: str, pages: dict[str, str]) -> None:
    assert (ROOT / name).read_text(encoding="utf-8") == pages[name], "run: make pages"


def test_every_setting_says_what_it_is(pages: dict[str, str]) -> None:
    rows = [
        line
        for name in ("docs/settings.md", "docs/field-file.md")
        for line in pages[name].splitlines()
        if line.startswith("| `")
    ]
    assert len(rows) > 130
    assert [row for row in rows if row.endswith("|  |")] == []
