"""The check of words reads comments, messages and pages, and names what to write instead."""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Any

import pytest

SCRIPTS = Path(__file__).parents[1] / "scripts"


@pytest.fixture
def lint(monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.syspath_prepend(SCRIPTS)
    return importlib.import_module("lint_language")


CODE = '''"""A docstring that tells."""
tell = f"the robot told {1} thing"  # nobody reads it
'''


def test_words_are_found_in_text_and_not_in_names(tmp_path: Path, lint: Any) -> None:
    (tmp_path / "src").mkdir()
    (tmp_path / "src" / "one.py").write_text(CODE)
    (tmp_path / "README.md").write_text("It is mended\nas it came.\n")
    found = lint.find_places(lint.read_words(), lint.iterate_places(tmp_path))
    places = {name: [(place.file, place.line) for place in found[name]] for name in found}
    assert places["tell"] == [("src/one.py", 1), ("src/one.py", 2)]
    assert places["nobody"] == [("src/one.py", 2)]
    assert places["mend"] == [("README.md", 1)]
    assert places["as it came"] == [("README.md", 2)]


PAGE = """/** A comment that tells. */
import { tell } from './tell.ts' // nobody
const names = { told: `${told} of which` }
"""


def test_the_words_of_the_operators_page_count_too(tmp_path: Path, lint: Any) -> None:
    folder = tmp_path / "web" / "src"
    folder.mkdir(parents=True)
    (folder / "one.ts").write_text(PAGE)
    (folder / "one.css").write_text(".told { color: red; } /* as it came */\n")
    (tmp_path / "web" / "index.html").write_text("<p>It is\nmended.</p>\n")
    found = lint.find_places(lint.read_words(), lint.iterate_places(tmp_path))
    places = {name: [(place.file, place.line) for place in found[name]] for name in found}
    assert places["tell"] == [
        ("web/src/one.ts", 1), ("web/src/one.ts", 2), ("web/src/one.ts", 3),
    ]  # fmt: skip
    assert places["nobody"] == [("web/src/one.ts", 2)]
    assert places["of which"] == [("web/src/one.ts", 3)]
    assert places["as it came"] == [("web/src/one.css", 1)]
    assert places["mend"] == [("web/index.html", 2)]


def test_every_word_has_a_limit_and_a_better_one(lint: Any) -> None:
    words = lint.read_words()
    assert len({word.name for word in words}) == len(words)
    assert all(word.instead and word.most >= 0 for word in words)


COMMENTED = """# Of a robot,
# in m.
WIDTH_M = 0.5
LEAST = 3  # it is enough
count = 1  # of rows
"""


def test_comments_are_read_whole_and_those_of_constants_apart(tmp_path: Path, lint: Any) -> None:
    (tmp_path / "src").mkdir()
    (tmp_path / "src" / "as_told.py").write_text(COMMENTED)
    places = list(lint.iterate_places(tmp_path))
    read = {kind: [p.text for p in places if p.kind == kind] for kind in ("comments", "constants")}
    assert read["comments"] == ["Of a robot, in m.", "it is enough", "of rows"]
    assert read["constants"] == ["Of a robot, in m.", "it is enough"]
    names = [place.text for place in places if place.kind == "names"]
    assert names == ["as_told", "WIDTH_M", "LEAST", "count"]


def test_code_in_text_is_no_text(tmp_path: Path, lint: Any) -> None:
    (tmp_path / "src").mkdir()
    (tmp_path / "src" / "one.py").write_text("""a = f"{told} `tell` told", "told"\n""")
    (tmp_path / "README.md").write_text("`told`\n```python\ntold = 1\n```\ntold\n")
    found = lint.find_places(lint.read_words(), lint.iterate_places(tmp_path))
    places = [(place.file, place.line) for place in found["tell"]]
    assert places == [("src/one.py", 1), ("README.md", 5)]
