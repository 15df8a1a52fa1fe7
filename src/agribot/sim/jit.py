"""Numba compilation for the inner loops of the simulator: physics exactly, pictures fast."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, cast

import numba

Function = TypeVar("Function", bound=Callable[..., object])
SOURCES = Path(__file__).parent
# Flags of fast arithmetic: sums may be reordered and fused; NaN and infinity keep their meaning.
FAST = {"nsz", "arcp", "contract", "afn", "reassoc"}


def compile_exact(function: Function) -> Function:
    """Compile without Python objects and without the GIL; keep the machine code on disk.

    It is kept as long as no file of the simulator changes: numba itself looks at the file of the
    function only, not at those of what it calls. Where no cache folder can be written, numba
    refuses to cache and the function is compiled anew in every process.
    """
    return _compile(function, fastmath=False)


def compile_fast(function: Function) -> Function:
    """Compile as `compile_exact`, for pictures: sums may be reordered."""
    return _compile(function, fastmath=FAST)


def inline_fast(function: Function) -> Function:
    """Copy a small function of the innermost loops into its callers before they are compiled."""
    return cast(Function, numba.njit(function, inline="always", error_model="numpy", fastmath=FAST))


def _compile(function: Function, fastmath: bool | set[str]) -> Function:
    options: dict[str, Any] = {"nogil": True, "error_model": "numpy", "fastmath": fastmath}
    try:
        compiled: Any = numba.njit(function, cache=True, **options)
    except RuntimeError:
        return cast(Function, numba.njit(function, **options))
    # Compared before anything else of the kept code is read, which may name what is gone.
    compiled._cache._cache_file._version = (numba.__version__, _stamp_sources(SOURCES))
    return cast(Function, compiled)


@cache
def _stamp_sources(folder: Path) -> tuple[tuple[str, int, int], ...]:
    """Name, time of change and size of every source file below a folder."""
    found = ((path, path.stat()) for path in sorted(folder.rglob("*.py")))
    return tuple(
        (str(path.relative_to(folder)), state.st_mtime_ns, state.st_size) for path, state in found
    )
