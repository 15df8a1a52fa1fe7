"""Check the words of comments, docstrings, messages and pages: `python scripts/lint_language.py`.

`scripts/words.toml` lists the words and what to write instead; the operator's page counts too.
With `--list NAME` prints every place of one entry.
"""

from __future__ import annotations

import argparse
import io
import re
import sys
import tokenize
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import msgspec

ROOT = Path(__file__).parents[1]
WORDS = Path(__file__).with_name("words.toml")
CODE = ("src", "scripts", "tests", "benchmarks", "examples")
WEB = ("web/src/**/*.ts", "web/src/**/*.css", "web/test/**/*.ts", "web/*.html")
PAGES = ("docs/**/*.md", "README.md", "CONTRIBUTING.md", "SECURITY.md")
# This check and its own test.
LEFT_OUT = {"scripts/lint_language.py", "tests/test_language.py"}
TEXTS = (tokenize.COMMENT, tokenize.STRING)
# Comments and strings of TypeScript and CSS; of HTML, which has little else, all of it.
WEB_TEXT = re.compile(
    r"""//[^\n]*|/\*.*?\*/|'(?:[^'\\\n]|\\.)*'|"(?:[^"\\\n]|\\.)*"|`(?:[^`\\]|\\.)*`""",
    re.DOTALL,
)
ALL_TEXT = re.compile(r".+", re.DOTALL)


class Word(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    name: str
    pattern: str
    instead: str
    most: int


class _Words(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    words: list[Word]


class Place(NamedTuple):
    file: str
    line: int
    text: str


def read_words(path: Path = WORDS) -> list[Word]:
    return msgspec.toml.decode(path.read_bytes(), type=_Words).words


def iterate_text(root: Path = ROOT) -> Iterator[Place]:
    """Yield each line of text: comments and strings of code, and whole pages of documents."""
    for folder in CODE:
        for path in sorted((root / folder).rglob("*.py")):
            yield from _read_code(path, path.relative_to(root).as_posix())
    for pattern in WEB:
        for path in sorted(root.glob(pattern)):
            yield from _read_web(path, path.relative_to(root).as_posix())
    for pattern in PAGES:
        for path in sorted(root.glob(pattern)):
            name = path.relative_to(root).as_posix()
            lines = path.read_text(encoding="utf-8").splitlines()
            yield from (Place(name, at, line) for at, line in enumerate(lines, 1))


def _read_code(path: Path, name: str) -> Iterator[Place]:
    source = path.read_text(encoding="utf-8")
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        is_text = token.type in TEXTS or tokenize.tok_name[token.type] == "FSTRING_MIDDLE"
        if is_text:
            for at, line in enumerate(token.string.splitlines(), token.start[0]):
                yield Place(name, at, line)


def _read_web(path: Path, name: str) -> Iterator[Place]:
    source = path.read_text(encoding="utf-8")
    for found in (ALL_TEXT if path.suffix == ".html" else WEB_TEXT).finditer(source):
        first = source.count("\n", 0, found.start()) + 1
        for at, line in enumerate(found.group().splitlines(), first):
            yield Place(name, at, line)


def find_places(words: list[Word], places: Iterator[Place]) -> dict[str, list[Place]]:
    """Find where each word stands; a line counts once for each time."""
    patterns = {word.name: re.compile(word.pattern, re.IGNORECASE) for word in words}
    found: dict[str, list[Place]] = {word.name: [] for word in words}
    for place in places:
        if place.file not in LEFT_OUT:
            for name, pattern in patterns.items():
                found[name] += [place] * len(pattern.findall(place.text))
    return found


def main() -> int:
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--list", metavar="NAME", help="print every place of one entry")
    name = parser.parse_args().list
    words = read_words()
    found = find_places(words, iterate_text())
    if name is not None:
        if name not in found:
            parser.error(f"--list {name}: not in {WORDS.name}; give one of {', '.join(found)}")
        sys.stdout.writelines(f"{p.file}:{p.line}: {p.text.strip()}\n" for p in found[name])
        return 0
    too_many = [word for word in words if len(found[word.name]) > word.most]
    for word in too_many:
        sys.stdout.write(
            f"words: '{word.name}' stands {len(found[word.name])} times, {word.most} are allowed; "
            f"write {word.instead} (python scripts/lint_language.py --list '{word.name}')\n"
        )
    return int(bool(too_many))


if __name__ == "__main__":
    sys.exit(main())
