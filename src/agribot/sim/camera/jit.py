"""Numba compilation of the renderer's loops, as in the rest of the simulator but faster.

Sums may be reordered and fused; NaN and infinity keep their meaning.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar, cast

import numba

Function = TypeVar("Function", bound=Callable[..., object])
FAST = {"nsz", "arcp", "contract", "afn", "reassoc"}


def compiled(function: Function) -> Function:
    """Compile without Python objects and without the GIL; keep the machine code on disk.

    Where no cache folder can be written, numba refuses to cache and the function is compiled
    anew in every process.
    """
    try:
        kept = numba.njit(function, cache=True, nogil=True, error_model="numpy", fastmath=FAST)
        return cast(Function, kept)
    except RuntimeError:
        kept = numba.njit(function, nogil=True, error_model="numpy", fastmath=FAST)
        return cast(Function, kept)


def inlined(function: Function) -> Function:
    """For small functions in the innermost loops: copied into their callers before compilation."""
    return cast(Function, numba.njit(function, inline="always", error_model="numpy", fastmath=FAST))
