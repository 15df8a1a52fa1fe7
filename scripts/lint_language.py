"""Check the words of comments, names, messages and pages: `python scripts/lint_language.py`.

`scripts/words.toml` lists the words and what to write instead; the operator's page counts too.
With `--list NAME` prints every place of one entry.
"""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Iterable
from pathlib import Path

import msgspec
from texts import Kind, Place, iterate_places

ROOT = Path(__file__).parents[1]
WORDS = Path(__file__).with_name("words.toml")
# This check and its own test.
LEFT_OUT = {"scripts/lint_language.py", "tests/test_language.py"}


class Word(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    name: str
    pattern: str
    instead: str
    most: int
    where: Kind = "text"


class _Words(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    words: list[Word]


def read_words(path: Path = WORDS) -> list[Word]:
    return msgspec.toml.decode(path.read_bytes(), type=_Words).words


def find_places(words: list[Word], places: Iterable[Place]) -> dict[str, list[Place]]:
    """Find where each word stands; a place counts once for each time."""
    patterns = {word: re.compile(word.pattern, re.IGNORECASE) for word in words}
    found: dict[str, list[Place]] = {word.name: [] for word in words}
    for place in places:
        if place.file not in LEFT_OUT:
            for word, pattern in patterns.items():
                if word.where == place.kind:
                    found[word.name] += [place] * len(pattern.findall(place.text))
    return found


def main() -> int:
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--list", metavar="NAME", help="print every place of one entry")
    name = parser.parse_args().list
    words = read_words()
    found = find_places(words, iterate_places(ROOT))
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
