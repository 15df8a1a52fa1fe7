"""A plugin that writes facts as `code(field=value)`: `pytest -p tests.facts_as_codes`.

A test that then fails is one of words. Those of the tables themselves are marked `wording` and
deselected. Programs that a test starts are not reached.
"""

from __future__ import annotations

import pytest

from agribot.core import fact_text
from agribot.core.facts import KINDS


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out the tests of the texts."""
    left_out = [item for item in items if item.get_closest_marker("wording")]
    config.hook.pytest_deselected(items=left_out)
    items[:] = [item for item in items if not item.get_closest_marker("wording")]


def pytest_configure(config: pytest.Config) -> None:
    """Put the codes in place of the English texts."""
    codes = fact_text.Table(
        {
            str(kind.__struct_config__.tag): fact_text.Entry(
                "{code}(" + ", ".join(f"{name}={{{name}}}" for name in kind.__struct_fields__) + ")"
            )
            for kind in KINDS
        },
        {"list": {"and": "and"}, "wheel": {}, "number": {"point": "."}},
    )
    read = fact_text.load_table

    def load(language: str) -> fact_text.Table:
        return codes if language == "en" else read(language)

    fact_text.load_table = load  # type: ignore[assignment]
