"""What to do with a calibration's result, as lines for a person."""

from __future__ import annotations

from collections.abc import Sequence


def verdict_lines(
    settings: Sequence[str], reasons: Sequence[str], described: Sequence[str] = ()
) -> list[str]:
    """`settings` and what to write into the robot's description, or why neither must be used."""
    if reasons:
        return [f"do not use it: {reason}" for reason in reasons]
    return ["to use it:", *(f"  --set '{setting}'" for setting in settings), *described]
