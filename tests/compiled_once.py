"""Where nothing is compiled yet, one worker compiles what all of them need.

Workers that collect the same files at the same time would each compile all of them, and so would
tests that draw the first picture in each worker.
"""

from __future__ import annotations

import contextlib
import importlib
import os
from pathlib import Path
from typing import Any

import pytest


def pytest_sessionstart(session: pytest.Session) -> None:
    if hasattr(session.config, "workerinput") and session.config.cache:
        import_own_share(session.config)
        take_turns_in_numba(session.config.cache.mkdir("compiled-once") / "lock")


def import_own_share(config: pytest.Config) -> None:
    """Import the files of tests that no other worker begins with; Python keeps their code."""
    worker, count = os.environ["PYTEST_XDIST_WORKER"], os.environ["PYTEST_XDIST_WORKER_COUNT"]
    folders = [config.rootpath / word.partition("::")[0] for word in config.args]
    files = sorted({path for folder in folders for path in folder.rglob("test_*.py")})
    for path in files[int(worker.removeprefix("gw")) :: int(count)]:
        with contextlib.suppress(Exception, pytest.skip.Exception):  # its collection reports it
            name = ".".join(path.relative_to(config.rootpath).with_suffix("").parts)
            importlib.import_module(name)


def take_turns_in_numba(lock: Path) -> None:
    """Let one worker at a time compile; the next one finds on the disk what this one compiled."""
    from filelock import FileLock  # slow
    from numba.core.dispatcher import Dispatcher

    loops: Any = Dispatcher
    compile_now, turn = loops.compile, FileLock(lock)

    def compile_in_turn(loop: Any, signature: Any) -> Any:
        with turn:
            return compile_now(loop, signature)

    loops.compile = compile_in_turn
