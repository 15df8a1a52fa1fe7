"""Advice on a calibration's result, as lines of text."""

from __future__ import annotations

from collections.abc import Sequence


def format_advice(
    settings: Sequence[str], reasons: Sequence[str], described: Sequence[str] = ()
) -> list[str]:
    """Format how to use the settings, with further lines `described`, or the reasons why not."""
    if reasons:
        return [f"do not use it: {reason}" for reason in reasons]
    return ["to use it:", *(f"  --set '{setting}'" for setting in settings), *described]
