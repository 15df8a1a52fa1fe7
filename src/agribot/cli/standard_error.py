"""Words for a person, beside the results on standard output."""

from __future__ import annotations

import contextlib
import os
import sys
from typing import TextIO


def print_line(text: str) -> None:
    """Print a line to standard error at once."""
    write_words(sys.stderr, f"{text}\n")


def write_words(stream: TextIO, text: str) -> None:
    """Write at once; where the terminal was closed, or its file has no room, words are dropped.

    Raises: BrokenPipeError: the program that read them has ended.
    """
    try:
        stream.write(text)
        stream.flush()
    except BrokenPipeError:
        raise
    except OSError:
        with contextlib.suppress(OSError, ValueError):
            drop_output(stream.fileno())


def drop_output(*handles: int) -> None:
    """Let what is written to these descriptors from now on go nowhere."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    for handle in handles:
        os.dup2(nowhere, handle)
    os.close(nowhere)
