"""Numba compilation for the inner loops of the simulator."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar, cast

import numba

Function = TypeVar("Function", bound=Callable[..., object])


def compiled(function: Function) -> Function:
    """Compile without Python objects and without the GIL; keep the machine code on disk.

    Where no cache folder can be written, numba refuses to cache and the function is compiled
    anew in every process.
    """
    try:
        return cast(Function, numba.njit(function, cache=True, nogil=True, error_model="numpy"))
    except RuntimeError:
        return cast(Function, numba.njit(function, nogil=True, error_model="numpy"))
