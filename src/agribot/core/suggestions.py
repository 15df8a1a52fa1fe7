"""Words that a person may have meant."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


def suggest_name(word: str, known: Iterable[str]) -> str:
    """Return "; did you mean 'x'?" for the nearest known word; empty where none is near."""
    close = difflib.get_close_matches(word, list(known), n=1, cutoff=0.5)
    return f"; did you mean '{close[0]}'?" if close else ""
