"""MuJoCo's C functions, for calls from compiled code."""

from __future__ import annotations

import ctypes
import logging
from pathlib import Path
from typing import NamedTuple

import mujoco
from llvmlite import ir  # type: ignore[import-untyped]
from numba import types
from numba.extending import intrinsic

from agribot.core.errors import PlatformError

_LOG = logging.getLogger(__name__)


class Library(NamedTuple):
    """Addresses of MuJoCo's two half steps and of the model and state they work on."""

    step1: int
    step2: int
    model: int
    data: int


def load_library(model: mujoco.MjModel, data: mujoco.MjData) -> Library:
    """Find the half steps in the shared library that the mujoco package has loaded.

    Raises: PlatformError: the package has no library where it is expected.
    """
    folder = Path(mujoco.__file__).parent
    names = ("libmujoco.so*", "libmujoco*.dylib", "mujoco.dll")
    found = sorted(path for name in names for path in folder.glob(name))
    if not found:
        raise PlatformError(
            f"no MuJoCo library in {folder}; reinstall with: pip install --force-reinstall "
            "mujoco-core"
        )
    # MuJoCo's default writes warnings to a file in the working folder.
    mujoco.set_mju_user_warning(_LOG.warning)
    library = ctypes.CDLL(str(found[0]))

    def address(name: str) -> int:
        return ctypes.cast(getattr(library, name), ctypes.c_void_p).value or 0

    return Library(address("mj_step1"), address("mj_step2"), model._address, data._address)


@intrinsic
def call(typing_context, address, model, data):  # type: ignore[no-untyped-def]
    """Call the C function `void (*)(model, data)` at an address, from compiled code.

    An address that arrives as an argument keeps the compiled loop fit for the disk cache.
    """
    signature = types.void(types.intp, types.intp, types.intp)

    def generate(context, builder, _signature, arguments):  # type: ignore[no-untyped-def]
        word = context.get_value_type(types.intp)
        kind = ir.FunctionType(ir.VoidType(), [word, word])
        function = builder.inttoptr(arguments[0], kind.as_pointer())
        builder.call(function, [arguments[1], arguments[2]])
        return context.get_dummy_value()

    return signature, generate
