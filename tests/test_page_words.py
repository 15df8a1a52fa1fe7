"""The pages are short enough to be read: each has a limit of words, and all of them together."""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Any

import pytest

SCRIPTS = Path(__file__).parents[1] / "scripts"


@pytest.fixture
def counter(monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.syspath_prepend(SCRIPTS)
    return importlib.import_module("count_words")


def test_no_page_and_no_sum_has_more_words_than_its_limit(counter: Any) -> None:
    assert counter.find_excess(counter.count(), counter.read_limits()) == []


def test_a_page_with_a_limit_of_its_own_exists_and_needs_it(counter: Any) -> None:
    words = {page.name: page.words for page in counter.count()}
    limits = counter.read_limits()
    assert [name for name in limits.longer if words.get(name, 0) <= limits.page] == []


def test_a_page_that_is_too_long_is_named_with_both_numbers(tmp_path: Path, counter: Any) -> None:
    (tmp_path / "docs").mkdir()
    (tmp_path / "README.md").write_text("Four words | here\n")
    (tmp_path / "docs" / "made.md").write_text("Written by `make pages`: " + "word " * 6)
    limits = counter.Limits(total=20, by_hand=3, page=9)
    assert counter.find_excess(counter.count(tmp_path), limits) == [
        "pages by hand: 4 words, 3 are allowed",
        "docs/made.md: 10 words, 9 are allowed",
    ]
