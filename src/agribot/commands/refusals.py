"""One line for whatever ended a command, and the traceback for those who ask for it."""

from __future__ import annotations

import contextlib
import os
import sys
import traceback

from agribot import extras
from agribot.errors import AgribotError

TRACEBACK = "AGRIBOT_TRACEBACK"
_HOW_TO_SEE = f"(set {TRACEBACK}=1 for the details)"


def refuse(program: str, error: Exception) -> None:
    """Say on stderr what happened. Prints the traceback as well where AGRIBOT_TRACEBACK is set."""
    if os.environ.get(TRACEBACK):
        traceback.print_exception(error)
    if isinstance(error, BrokenPipeError):
        _drop_output()
    sys.stderr.write(f"{program}: {words_of(error)}\n")


def words_of(error: Exception) -> str:
    """One line that a user can act on; what nobody foresaw is called an internal error."""
    if isinstance(error, AgribotError):
        return str(error)
    if isinstance(error, ModuleNotFoundError):
        known = extras.explain(error)
        if known:
            return known
    for kind, say in _WORDS:
        if isinstance(error, kind):
            return _one_line(say(error))
    return _one_line(f"internal error: {type(error).__name__}: {error} {_HOW_TO_SEE}")


def _of_system(error: Exception) -> str:
    name, reason = getattr(error, "filename", None), getattr(error, "strerror", None)
    place = f"{name}: " if name is not None else ""
    return f"{place}{reason or error}; check the path, its permissions and the free space"


def _of_text(error: Exception) -> str:
    return f"an input is not text in UTF-8 ({error}); save it as UTF-8 {_HOW_TO_SEE}"


def _of_value(error: Exception) -> str:
    return f"an input holds a value that cannot be used: {error} {_HOW_TO_SEE}"


def _of_memory(error: Exception) -> str:
    return f"not enough memory: {error or 'give a smaller input'} {_HOW_TO_SEE}"


def _of_depth(_: Exception) -> str:
    return f"an input is nested too deeply, or includes itself {_HOW_TO_SEE}"


def _of_end(error: Exception) -> str:
    return f"an input ends too early: {error or 'it is cut off'} {_HOW_TO_SEE}"


# The first kind that fits; subclasses stand before what they derive from.
_WORDS = (
    (OSError, _of_system),
    (UnicodeError, _of_text),
    (ValueError, _of_value),
    (OverflowError, _of_value),
    (MemoryError, _of_memory),
    (RecursionError, _of_depth),
    (EOFError, _of_end),
)


def _one_line(text: str) -> str:
    return " ".join(text.split())


def _drop_output() -> None:
    """Nobody reads any more: the interpreter must not try to write the rest when it ends."""
    with contextlib.suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
