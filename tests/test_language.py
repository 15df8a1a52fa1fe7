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
    found = lint.find_places(lint.read_words(), lint.iterate_text(tmp_path))
    places = {name: [(place.file, place.line) for place in found[name]] for name in found}
    assert places["tell"] == [("src/one.py", 1), ("src/one.py", 2)]
    assert places["nobody"] == [("src/one.py", 2)]
    assert places["mend"] == [("README.md", 1)]
    assert places["as it came"] == [("README.md", 2)]


def test_every_word_has_a_limit_and_a_better_one(lint: Any) -> None:
    words = lint.read_words()
    assert len({word.name for word in words}) == len(words)
    assert all(word.instead and word.most >= 0 for word in words)
