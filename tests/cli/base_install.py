"""A program of the tests: run commands in a process in which no package of an extra can be found.

Reads command lines from stdin as JSON and writes (status, stderr) of each to stdout.
"""

from __future__ import annotations

import contextlib
import importlib.abc
import io
import json
import sys
from collections.abc import Sequence

from agribot.core import extras

# A package that a base package brings as well.
ALSO_IN_THE_BASE = {"ruamel"}


class Hidden(importlib.abc.MetaPathFinder):
    def __init__(self) -> None:
        found = list(extras.read_requirements())
        base = {one.module.split(".")[0] for one in found if not one.extra} | ALSO_IN_THE_BASE
        self.modules = {one.module.split(".")[0] for one in found if one.extra} - base

    def find_spec(self, name: str, path: object = None, target: object = None) -> None:
        if name.partition(".")[0] in self.modules:
            raise ModuleNotFoundError(f"No module named '{name}'", name=name)


def status_of(arguments: Sequence[str]) -> int:
    from agribot.cli.main import main

    try:
        return main(arguments)
    except SystemExit as stop:
        return int(stop.code or 0)


if __name__ == "__main__":
    sys.meta_path.insert(0, Hidden())
    answers = []
    for arguments in json.load(sys.stdin):
        said = io.StringIO()
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(said):
            status = status_of(arguments)
        answers.append((status, said.getvalue()))
    sys.stdout.write(json.dumps(answers) + "\n")
