"""Numba compilation for the inner loops of the simulator: physics exactly, pictures fast."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba

Function = TypeVar("Function", bound=Callable[..., object])
# Sums may be reordered and fused; NaN and infinity keep their meaning.
FAST = {"nsz", "arcp", "contract", "afn", "reassoc"}


def compile_exact(function: Function) -> Function:
    """Compile without Python objects and without the GIL; keep the machine code on disk.

    Where no cache folder can be written, numba refuses to cache and the function is compiled
    anew in every process.
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
        return cast(Function, numba.njit(function, cache=True, **options))
    except RuntimeError:
        return cast(Function, numba.njit(function, **options))
