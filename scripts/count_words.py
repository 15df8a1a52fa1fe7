"""Check how many words the pages have: `python scripts/count_words.py`.

`scripts/page_words.toml` holds the limits; `--list` prints every page with its kind and words.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Literal, NamedTuple

import msgspec

ROOT = Path(__file__).parents[1]
LIMITS = Path(__file__).with_name("page_words.toml")
PAGES = ("README.md", "CONTRIBUTING.md", "docs/**/*.md")
Kind = Literal["made", "results", "contributors", "by hand"]


class Limits(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Most words of all pages, of those by hand for users, and of a page outside of `longer`."""

    total: int
    by_hand: int
    page: int
    longer: dict[str, int] = {}


class Page(NamedTuple):
    name: str
    kind: Kind
    words: int


def read_limits(path: Path = LIMITS) -> Limits:
    return msgspec.toml.decode(path.read_bytes(), type=Limits)


def count(root: Path = ROOT) -> list[Page]:
    """Count the words of each page, as `wc -w` does."""
    paths = sorted(path for pattern in PAGES for path in root.glob(pattern))
    return [_count_page(path, path.relative_to(root).as_posix()) for path in paths]


def _count_page(path: Path, name: str) -> Page:
    text = path.read_text(encoding="utf-8")
    return Page(name, _find_kind(name, text), len(text.split()))


def _find_kind(name: str, text: str) -> Kind:
    if "Written by `make pages`" in text:
        return "made"
    if name.startswith("docs/results/"):
        return "results"
    return "contributors" if name.startswith(("CONTRIBUTING", "docs/contribute/")) else "by hand"


def find_excess(pages: list[Page], limits: Limits) -> list[str]:
    """Say which page, or which sum, has more words than its limit."""
    sums = (
        ("all pages", sum(page.words for page in pages), limits.total),
        ("pages by hand", sum(p.words for p in pages if p.kind == "by hand"), limits.by_hand),
        *((page.name, page.words, limits.longer.get(page.name, limits.page)) for page in pages),
    )
    return [
        f"{name}: {words} words, {most} are allowed" for name, words, most in sums if words > most
    ]


def main() -> int:
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--list", action="store_true", help="print every page")
    pages = count()
    if parser.parse_args().list:
        sys.stdout.writelines(f"{page.words:6} {page.kind:13} {page.name}\n" for page in pages)
    excess = find_excess(pages, read_limits())
    sys.stdout.writelines(
        f"{line}; shorten it, or move what is measured to results\n" for line in excess
    )
    return int(bool(excess))


if __name__ == "__main__":
    sys.exit(main())
