"""The documents are a site: every page is in its menu, every link and anchor leads somewhere."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from mkdocs.commands.build import build
from mkdocs.config import load_config

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build it; a page outside the menu or a broken link is an error."""
    folder = tmp_path_factory.mktemp("site")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("NO_MKDOCS_2_WARNING", "1")
        config = load_config(str(ROOT / "mkdocs.yml"), site_dir=str(folder), strict=True)
        config.plugins.on_startup(command="build", dirty=False)
        build(config)
    return folder


def test_every_page_is_built_with_those_of_the_root(site: Path) -> None:
    pages = {path.relative_to(ROOT / "docs") for path in (ROOT / "docs").rglob("*.md")}
    pages |= {Path("readme.md"), Path("contributing.md"), Path("changelog.md")}
    assert all((site / page).with_suffix(".html").is_file() for page in pages)


def test_the_search_finds_what_a_page_says(site: Path) -> None:
    index = json.loads((site / "search" / "search_index.json").read_text(encoding="utf-8"))
    found = {entry["location"] for entry in index["docs"] if "protection level" in entry["text"]}
    assert any(place.startswith("navigation.html") for place in found)


def test_nothing_is_loaded_from_another_place(site: Path) -> None:
    loads = re.compile(r'<(?:script|img|iframe)[^>]* src="https?:|<link[^>]* href="https?:')
    assert not [path.name for path in site.rglob("*.html") if loads.search(path.read_text("utf-8"))]


def test_pictures_of_the_first_page_are_there(site: Path) -> None:
    text = (site / "readme.html").read_text(encoding="utf-8")
    pictures = re.findall(r'src="(images/[^"]+)"', text)
    assert len(pictures) == 3
    assert all((site / name).is_file() for name in pictures)


def test_every_block_of_code_is_one_and_bears_the_name_of_its_file(site: Path) -> None:
    pages = {path: path.read_text("utf-8") for path in site.rglob("*.html")}
    assert not [path.name for path, text in pages.items() if "```" in text]
    text = pages[site / "tutorials" / "your-field.html"]
    assert '<span class="filename">field.toml</span>' in text
