"""Workers of a fresh checkout share what has to be compiled (tests/compiled_once.py)."""

from __future__ import annotations

import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from filelock import FileLock, Timeout
from numba.core.dispatcher import Dispatcher

from tests.compiled_once import import_own_share, take_turns_in_numba


@pytest.mark.parametrize("worker", [0, 1, 2])
def test_each_file_is_imported_first_by_one_worker(
    worker: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    names = [f"test_share_{worker}_{number}" for number in range(7)]
    for name in names:
        (tmp_path / f"{name}.py").write_text("raise OSError" if name.endswith("3") else "DONE = 1")
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setenv("PYTEST_XDIST_WORKER", f"gw{worker}")
    monkeypatch.setenv("PYTEST_XDIST_WORKER_COUNT", "3")
    config = SimpleNamespace(rootpath=tmp_path, args=[".", f"{names[0]}.py::test_it"])
    import_own_share(config)  # type: ignore[arg-type]
    imported = [name for name in names if sys.modules.pop(name, None)]
    assert imported == [name for name in names[worker::3] if not name.endswith("3")]


def test_loops_are_compiled_by_one_worker_at_a_time_and_by_it_within_each_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    lock = tmp_path / "lock"
    loops: Any = Dispatcher

    def compile_two(loop: str, depth: int) -> str:
        with pytest.raises(Timeout):
            FileLock(lock).acquire(timeout=0)
        return f"{depth} {loops.compile(loop, depth - 1)}" if depth else loop

    monkeypatch.setattr(Dispatcher, "compile", compile_two)
    take_turns_in_numba(lock)
    assert loops.compile("a loop", 2) == "2 1 a loop"
    FileLock(lock).acquire(timeout=0).lock.release()
