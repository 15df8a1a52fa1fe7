"""Machine code of the simulator is kept on disk as long as it is that of the sources."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from typing import Any

import pytest

from agribot.sim import jit

CALLER = """
from agribot.sim.jit import compile_exact
import called

@compile_exact
def double_and_add(x):
    return called.double(x) + 1.0
"""
CALLED = """
from agribot.sim.jit import compile_exact

@compile_exact
def double(x):
    return FACTOR * x
"""


@pytest.fixture(autouse=True)
def _python_keeps_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """A source of the same length, changed within a second, is the same to Python's own cache."""
    monkeypatch.setattr(sys, "dont_write_bytecode", True)


def load(folder: Path, name: str) -> Any:
    """A module of a folder, anew."""
    jit._stamp_sources.cache_clear()
    spec = importlib.util.spec_from_file_location(name, folder / f"{name}.py")
    assert spec and spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_a_change_in_what_a_function_calls_compiles_it_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(jit, "SOURCES", tmp_path)
    (tmp_path / "caller.py").write_text(CALLER)

    def compute(factor: str) -> tuple[float, int]:
        """The result, and how often kept machine code was used for it."""
        text, path = CALLED.replace("FACTOR", factor), tmp_path / "called.py"
        if not path.exists() or path.read_text() != text:
            path.write_text(text)
        monkeypatch.setitem(sys.modules, "called", load(tmp_path, "called"))
        function = load(tmp_path, "caller").double_and_add
        return function(10.0), sum(function.stats.cache_hits.values())

    assert compute("2.0") == (21.0, 0)
    assert compute("2.0") == (21.0, 1)
    assert compute("3.5") == (36.0, 0)


def test_kept_machine_code_that_names_what_is_gone_is_compiled_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(jit, "SOURCES", tmp_path)
    shape = "from typing import NamedTuple\nclass NAME(NamedTuple):\n    x: float\n"
    taker = (
        "from agribot.sim.jit import compile_exact\n@compile_exact\ndef take(v):\n    return v.x"
    )
    (tmp_path / "taker.py").write_text(taker)
    for name in ("View", "PinholeView"):
        (tmp_path / "shape.py").write_text(shape.replace("NAME", name))
        module = load(tmp_path, "shape")
        monkeypatch.setitem(sys.modules, "shape", module)
        assert load(tmp_path, "taker").take(getattr(module, name)(3.0)) == 3.0
