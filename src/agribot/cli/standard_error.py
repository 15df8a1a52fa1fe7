"""Words for a person, beside the results on standard output."""

from __future__ import annotations

import sys


def print_line(text: str) -> None:
    """Print a line to standard error at once."""
    sys.stderr.write(text + "\n")
    sys.stderr.flush()
