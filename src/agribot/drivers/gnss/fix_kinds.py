"""How a receiver came to a place: by satellites, with their quality, or without any."""

from __future__ import annotations

from typing import TypedDict

from agribot.core.messages import GnssQuality, Unmeasured

FixKind = GnssQuality | Unmeasured
DEAD_RECKONING: Unmeasured = "dead reckoning"
HELD: Unmeasured = "held"


class _Fields(TypedDict, total=False):
    quality: GnssQuality
    unmeasured: Unmeasured


def make_fields(kind: FixKind) -> _Fields:
    """Make the fields of a GnssFix that state it."""
    if isinstance(kind, GnssQuality):
        return {"quality": kind}
    return {"quality": GnssQuality.NONE, "unmeasured": kind}
