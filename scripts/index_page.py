"""Print docs/index.md: every page in the order of the site's menu, each with its first sentence.

`make pages` writes all such pages.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import yaml
from docs_hooks import PAGES
from llms_page import find_summary

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
HEAD = """# AGRIBOT: all pages

Written by `make pages` from the menu. [README](../README.md) has the start, [commands](commands.md)
an example of each.
"""
# Names in the menu of the pages that lie in the repository's root.
OF_ROOT = {name: source for source, name in PAGES.items()}


def page() -> str:
    menu = yaml.safe_load((ROOT / "mkdocs.yml").read_text(encoding="utf-8"))["nav"]
    sections = (entry for entry in menu if not isinstance(next(iter(entry.values())), str))
    return HEAD + "".join(_write_section(section) for section in sections)


def _write_section(section: dict[str, list[Any]]) -> str:
    ((title, entries),) = section.items()
    lines = (_write_line(*page) for page in _list_pages(entries))
    return f"\n## {title}\n\n{''.join(lines)}"


def _list_pages(entries: list[Any]) -> Iterator[tuple[str, str]]:
    """List title and name of each page, those of sections inside included."""
    for entry in entries:
        ((title, inner),) = entry.items()
        if isinstance(inner, str):
            yield title, inner
        else:
            yield from ((f"{title}: {name}", page) for name, page in _list_pages(inner))


def _write_line(title: str, name: str) -> str:
    path = ROOT / OF_ROOT[name] if name in OF_ROOT else DOCS / name
    link = os.path.relpath(path, DOCS)
    return f"- [{title}]({link}): {find_summary(path)}\n"


if __name__ == "__main__":
    sys.stdout.write(page())
