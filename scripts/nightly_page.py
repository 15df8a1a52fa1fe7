"""Print docs/nightly.md: the tests that `make test` leaves to the night.

They are read from the decorators of tests/nightly.py, the last results from
tests/nightly-results.csv. `make pages` writes all such pages.
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
HEAD = """# What runs at night

Written by `make pages` from the decorators of [`tests/nightly.py`](../tests/nightly.py).

`make test` proves every behaviour once, in its cheapest form. `make nightly` runs what is left:
statistics, long drives, whole missions and browser journeys, in shards that can be run alone
(`make nightly TESTS=tests/mission`). It writes the last result of each file, with date, commit and
machine, to `tests/nightly-results.csv`, and lists the files that
did not run for two weeks.

## The same test with more

By day with fewer seeds, drives or cases; at night with all.

| test | by day | at night |
|---|---|---|
"""
BY_DAY = """
## Tests with a cheaper form by day

| left to the night | proved by day in |
|---|---|
"""


def page() -> str:
    files = read_files()
    counts = [row for path, tree in files.items() for row in _list_counts(path, tree)]
    moved = [
        f"| `{_name(path)}`: {_say(test)} | {', '.join(_link(day) for day in days)} |\n"
        for path, tree in files.items()
        for test, days in list_by_day(tree).items()
    ]
    return HEAD + "".join(counts) + BY_DAY + "".join(moved)


def read_files() -> dict[Path, ast.Module]:
    """Read the files of tests that leave something to the night."""
    texts = {path: path.read_text("utf-8") for path in sorted((ROOT / "tests").rglob("test_*.py"))}
    return {path: ast.parse(text) for path, text in texts.items() if "nightly." in text}


def list_by_day(tree: ast.Module) -> dict[str, list[str]]:
    """List what `nightly.by_day` leaves to the night: test -> the tests that prove it by day.

    A test whose other cases run by day has "part of " before its name; a file as a whole is "*".
    """
    found: dict[str, list[str]] = {}
    for name, part in _list_marks(tree):
        for call in ast.walk(part):
            if isinstance(call, ast.Call) and ast.unparse(call.func) == "nightly.by_day":
                is_part = ast.unparse(part).startswith(("pytest.mark.param", "pytest.fixture"))
                days = found.setdefault(f"part of {name}" if is_part else name, [])
                days += [day for day in map(ast.literal_eval, call.args) if day not in days]
    return found


def _list_marks(tree: ast.Module) -> Iterator[tuple[str, ast.AST]]:
    """Yield each decorator with the name of its function, and `pytestmark` with "*"."""
    for node in tree.body:
        if isinstance(node, ast.FunctionDef):
            yield from ((node.name, decorator) for decorator in node.decorator_list)
        elif isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "pytestmark":
            yield "*", node.value


def _list_counts(path: Path, tree: ast.Module) -> Iterator[str]:
    for name, part in _list_marks(tree):
        if isinstance(part, ast.Call) and ast.unparse(part.func) in {
            "nightly.all_or_first",
            "nightly.one_by_one",
        }:
            words = [*part.args[2:], *(word.value for word in part.keywords)]
            cases = ast.unparse(part.args[1]).replace("|", "\\|")
            yield f"| `{_name(path)}`: {_say(name)} | {ast.unparse(words[0])} | `{cases}` |\n"


def _name(path: Path) -> str:
    return str(path.relative_to(ROOT / "tests"))


def _say(test: str) -> str:
    return "all of it" if test == "*" else test.replace("test_", "", 1).replace("_", " ")


def _link(day: str) -> str:
    file, _, test = day.rpartition("::")
    return (f"`{file.removeprefix('tests/')}`: " if file else "") + _say(test)


if __name__ == "__main__":
    sys.stdout.write(page())
