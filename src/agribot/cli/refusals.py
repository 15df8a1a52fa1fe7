"""One line for whatever ended a command, and the traceback for those who request it."""

from __future__ import annotations

import contextlib
import os
import select
import sys
import traceback
from typing import TextIO

from agribot.core import extras
from agribot.core.errors import AgribotError

TRACEBACK = "AGRIBOT_TRACEBACK"
BROKEN_PIPE = 141  # a shell's status of a program that SIGPIPE ended
_HOW_TO_SEE = f"(set {TRACEBACK}=1 for the details)"


def refuse(program: str, error: Exception) -> int:
    """Print on stderr what happened, and return the exit status.

    Prints the traceback as well where AGRIBOT_TRACEBACK is set. Prints nothing where the reader of
    the output has gone, such as `head`: the program ends as SIGPIPE ends others.
    """
    if isinstance(error, BrokenPipeError) and _has_reader_gone():
        _drop_output()
        return BROKEN_PIPE
    if os.environ.get(TRACEBACK):
        traceback.print_exception(error)
    with contextlib.suppress(OSError):  # no program reads it
        sys.stderr.write(f"{program}: {describe_error(error)}\n")
    _drop_output()
    return 2


def describe_error(error: Exception) -> str:
    """Describe an error in one line that a user can act on; others are internal errors."""
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


def _describe_system(error: Exception) -> str:
    name, reason = getattr(error, "filename", None), getattr(error, "strerror", None)
    place = f"{name}: " if name is not None else ""
    return f"{place}{reason or error}; check the path, its permissions and the free space"


def _describe_connection(error: Exception) -> str:
    return f"another program is not there, or has gone: {error} {_HOW_TO_SEE}"


def _describe_text(error: Exception) -> str:
    return f"an input is not text in UTF-8 ({error}); save it as UTF-8 {_HOW_TO_SEE}"


def _describe_memory(error: Exception) -> str:
    return f"not enough memory: {error or 'give a smaller input'} {_HOW_TO_SEE}"


def _describe_depth(_: Exception) -> str:
    return f"an input is nested too deeply, or includes itself {_HOW_TO_SEE}"


def _describe_end(error: Exception) -> str:
    return f"an input ends too early: {error or 'it is cut off'} {_HOW_TO_SEE}"


# The first kind that fits; subclasses stand before what they derive from.
_WORDS = (
    (ConnectionError, _describe_connection),
    (OSError, _describe_system),
    (UnicodeError, _describe_text),
    (MemoryError, _describe_memory),
    (RecursionError, _describe_depth),
    (EOFError, _describe_end),
)


def _one_line(text: str) -> str:
    return " ".join(text.split())


def _has_reader_gone() -> bool:
    """Return whether stdout or stderr is a pipe without a reader."""
    if not hasattr(select, "poll"):
        return True
    ended = select.poll()
    for stream in _open_streams():
        with contextlib.suppress(OSError, ValueError):
            ended.register(stream.fileno(), 0)  # an end is reported without a request
    return bool(ended.poll(0))


def _open_streams() -> list[TextIO]:
    """List stdout and stderr, less what the program was started without."""
    return [stream for stream in (sys.stdout, sys.stderr) if stream is not None]


def _drop_output() -> None:
    """Drop what cannot be written, so that the interpreter does not try again at its end."""
    for stream in _open_streams():
        try:
            stream.flush()
        except OSError:
            with contextlib.suppress(OSError, ValueError):
                os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
