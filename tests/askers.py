"""Which tests ask for programs that a machine may lack: `pytest --askers` runs those alone.

A test asks when its file, that of a fixture of it, or what these import of the tests, imports
`tests/machine.py`. Without the programs no other test ends otherwise: one that starts such a
program, or asks for it, and is not found here fails on every machine.
"""

from __future__ import annotations

import ast
import os
import sys
from collections.abc import Generator, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from tests import machine

ROOT = Path(__file__).parents[1]
MACHINE = ROOT / "tests" / "machine.py"
needed: list[str] = []  # programs, since the last phase of a test


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--askers",
        action="store_true",
        help="collect all tests, but run only those that ask for programs",
    )


def pytest_configure() -> None:
    sys.addaudithook(_note)


def _note(event: str, arguments: tuple[Any, ...]) -> None:
    if event == machine.ASKED:
        needed.append(arguments[0])
    elif event == "subprocess.Popen":
        program = Path(os.fsdecode(arguments[0])).name
        if program in machine.HIDDEN:
            needed.append(program)


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    if config.getoption("--askers"):
        config.hook.pytest_deselected(items=[item for item in items if not is_asker(item)])
        items[:] = [item for item in items if is_asker(item)]


def pytest_collection_finish() -> None:
    needed.clear()  # for marks, in files that ask


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item,
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    report = yield
    programs = sorted(set(needed))
    needed.clear()
    if programs and not is_asker(item):
        report.outcome = "failed"
        report.longrepr = (
            f"needs {', '.join(programs)} and is not found to ask for it: neither its file nor "
            "one of its fixtures' files leads to tests/machine.py"
        )
    return report


def is_asker(item: pytest.Item) -> bool:
    return any(map(_leads_to_machine, _list_files(item)))


def _list_files(item: pytest.Item) -> Iterator[Path]:
    """List the file of a test and those of its fixtures."""
    yield item.path
    fixtures = getattr(item, "_fixtureinfo").name2fixturedefs  # noqa: B009  no public way to them
    for definitions in fixtures.values():
        for definition in definitions:
            yield Path(definition.func.__code__.co_filename)


@cache
def _leads_to_machine(path: Path) -> bool:
    found, waiting = {path}, [path]
    while waiting:
        new = _list_imports(waiting.pop()) - found
        found |= new
        waiting += new
    return MACHINE in found


@cache
def _list_imports(path: Path) -> frozenset[Path]:
    """List the files of the tests that a file imports, at any level of it."""
    if path.suffix != ".py" or not path.is_file():
        return frozenset()
    names = set()
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    files = {ROOT / f"{name.replace('.', '/')}.py" for name in names if name.startswith("tests.")}
    return frozenset(filter(Path.is_file, files))
