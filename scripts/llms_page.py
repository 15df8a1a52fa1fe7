"""Print llms.txt: an index of the pages for programs that read them (llmstxt.org).

`make pages` writes all such pages.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
HEAD = """# AGRIBOT

> Software for a small field robot that finds weeds and sprays or hoes them, and the simulated farm
> to develop it on. Python 3.11 or newer and pip; no ROS, GPU or display. It speaks ROS 1, ROS 2,
> Foxglove and QGIS. `make run` drives the farm, `make test` runs the tests.

"""
# A link is its text, a picture nothing; a sentence ends before a space or the end of its line.
LINK = re.compile(r"!?\[([^\]]*)\]\([^)]*\)")
# Links in parentheses.
ASIDE = re.compile(r" \((?:\[[^\]]*\]\([^)]*\)(?:, )?)+\)")
SENTENCE = re.compile(r".+?[.:](?=\s+[A-Z`]|$)", re.DOTALL)
SECTIONS = {
    "Tutorials": "docs/tutorials/*.md",
    "How to": "docs/how-to/*.md",
    "Pages": "docs/*.md",
    "Results": "docs/results/*.md",
    "Adding something": "docs/contribute/*.md",
}


def page() -> str:
    """Write the index: each page with its title and its first sentence."""
    parts = [HEAD, "## Start\n\n", _line(ROOT / "README.md"), _line(ROOT / "CONTRIBUTING.md")]
    for title, pattern in SECTIONS.items():
        parts.append(f"\n## {title}\n\n")
        parts += [_line(path) for path in sorted(ROOT.glob(pattern))]
    return "".join(parts)


def _line(path: Path) -> str:
    title = path.read_text(encoding="utf-8").partition("\n")[0]
    return f"- [{title.lstrip('# ')}]({path.relative_to(ROOT)}): {find_summary(path)}\n"


def find_summary(path: Path) -> str:
    """Find the first sentence of a page."""
    return _find_sentence(path.read_text(encoding="utf-8").partition("\n")[2])


def _find_sentence(text: str) -> str:
    """Find the first sentence that is not about how the page is made."""
    is_code = False
    for block in text.split("\n\n"):
        is_code ^= block.count("```") % 2 == 1
        bare = ASIDE.sub("", block)
        words = LINK.sub(lambda link: "" if link[0][0] == "!" else link[1], bare).strip()
        if is_code or not words or words.startswith(("|", "#", "```", "<", "-")):
            continue
        sentences = [" ".join(found.split()) for found in SENTENCE.findall(words)]
        said = [sentence for sentence in sentences if "make pages" not in sentence]
        if said:
            return said[0].rstrip(":") + ("" if said[0].endswith(".") else ".")
    return "see the page."


if __name__ == "__main__":
    sys.stdout.write(page())
