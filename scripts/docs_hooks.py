"""Hooks of mkdocs.yml: links that leave docs/ lead to a page of the site, or are plain text.

README.md, CONTRIBUTING.md and CHANGELOG.md become pages; source files have no page here. What the
tests read behind the language of a block (`sh run`, `toml file=NAME`) is no option of Markdown: a
file becomes the title of its block.
"""

from __future__ import annotations

import re
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).parents[1]
# Pages of the repository's root and their names in the site.
PAGES = {
    "README.md": "readme.md",
    "CONTRIBUTING.md": "contributing.md",
    "CHANGELOG.md": "changelog.md",
}
_LINK = re.compile(r"(?<!!)\[([^\]]*)\]\(([^)#\s]*)(#[^)\s]*)?\)")
_BLOCK = re.compile(r"^```(\w+) (?:run|file=(\S+))$", re.MULTILINE)


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages of the repository's root."""
    for source, name in PAGES.items():
        text = (ROOT / source).read_text(encoding="utf-8")
        files.append(File.generated(config, name, content=_move_links(text)))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Lead links that leave docs/ to pages of the site, and name the files of blocks."""
    depth = page.file.src_uri.count("/")

    def lead(link: re.Match[str]) -> str:
        words, target, anchor = link[1], link[2], link[3] or ""
        if "://" in target or not target.startswith("../" * (depth + 1)):
            return link[0]
        name = PAGES.get(target.removeprefix("../" * (depth + 1)))
        return f"[{words}]({'../' * depth}{name}{anchor})" if name else words

    return _BLOCK.sub(_title, _LINK.sub(lead, markdown))


def _title(block: re.Match[str]) -> str:
    return f'```{block[1]} title="{block[2]}"' if block[2] else f"```{block[1]}"


def _move_links(text: str) -> str:
    """Make links of a page of the root those of a page of docs/."""

    def lead(link: re.Match[str]) -> str:
        words, target, anchor = link[1], link[2], link[3] or ""
        if "://" in target or not target:
            return link[0]
        if target in PAGES:
            return f"[{words}]({PAGES[target]}{anchor})"
        is_page = target.startswith("docs/") and target.endswith(".md")
        return f"[{words}]({target.removeprefix('docs/')}{anchor})" if is_page else words

    return _LINK.sub(lead, text.replace("docs/images/", "images/"))
