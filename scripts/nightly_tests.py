"""Print every test that `make test` leaves to the night: `python scripts/nightly_tests.py`.

Beside it stand the counts of day and night, or the tests that prove the same by day, as the
decorators of tests/nightly.py say.
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]


def list_all() -> str:
    """List every test of the night, with its counts or the tests that prove it by day."""
    lines = []
    for path, tree in read_files().items():
        lines += [f"{_name(path)}: {line}\n" for line in list_counts(tree)]
        for test, days in list_by_day(tree).items():
            lines.append(f"{_name(path)}: {_say(test)}: {', '.join(_link(day) for day in days)}\n")
    return "".join(lines)


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


def list_counts(tree: ast.Module) -> Iterator[str]:
    """List the tests that run by day with fewer cases: name, cases by day, cases at night."""
    for name, part in _list_marks(tree):
        if isinstance(part, ast.Call) and ast.unparse(part.func) in {
            "nightly.all_or_first",
            "nightly.one_by_one",
        }:
            words = [*part.args[2:], *(word.value for word in part.keywords)]
            cases = ast.unparse(part.args[1])
            yield f"{_say(name)}: {ast.unparse(words[0])} by day, at night {cases}"


def _name(path: Path) -> str:
    return str(path.relative_to(ROOT / "tests"))


def _say(test: str) -> str:
    return "all of it" if test == "*" else test.replace("test_", "", 1).replace("_", " ")


def _link(day: str) -> str:
    file, _, test = day.rpartition("::")
    return (f"{file.removeprefix('tests/')}: " if file else "") + _say(test)


if __name__ == "__main__":
    sys.stdout.write(list_all())
