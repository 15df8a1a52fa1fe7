"""Work that would hold up every page if the server's loop did it."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar, TypeVarTuple

import anyio
import anyio.to_process
import anyio.to_thread

from agribot.core.facts import ReaderEnded, TookTooLong
from agribot.core.facts.page import Handed
from agribot.ui.server.answers import Unusable

T = TypeVar("T")
Args = TypeVarTuple("Args")

FILE_TIMEOUT_S = 30.0
# Limit of processes: each has its own memory, and takes a core from the robot.
PROCESSES = anyio.CapacityLimiter(2)
THREADS = anyio.CapacityLimiter(2)  # limit of threads: more busy ones starve the loop


async def run_in_process(
    function: Callable[[*Args], T], *args: *Args, timeout_s: float = FILE_TIMEOUT_S, what: Handed
) -> T:
    """For files of strangers: whatever they do to the process, it is ended in time.

    Raises: Unusable: it took too long, or died.
    """
    try:
        with anyio.fail_after(timeout_s):
            return await anyio.to_process.run_sync(
                function, *args, cancellable=True, limiter=PROCESSES
            )
    except TimeoutError as error:
        raise Unusable(504, TookTooLong(what, timeout_s)) from error
    except anyio.BrokenWorkerProcess as error:
        raise Unusable(422, ReaderEnded(what)) from error


async def run_in_thread(function: Callable[[*Args], T], *args: *Args) -> T:
    """For what is long but ours; two at a time, the others wait."""
    return await anyio.to_thread.run_sync(function, *args, limiter=THREADS)
