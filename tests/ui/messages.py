"""Messages for tests that do not care what else stands in them."""

from __future__ import annotations

import time

from agribot.core.messages import PlantClass
from agribot.ui import wire


def make_weed(id: int, x_map_m: float = 1.0, y_map_m: float = 2.0) -> wire.Weed:
    return wire.Weed(
        id=id, plant=PlantClass.WEED, x_map_m=x_map_m, y_map_m=y_map_m, std_m=0.02, confidence=0.9,
        area_m2=0.001, sightings=4, first_seen_s=1.0, last_seen_s=2.0,
    )  # fmt: skip


def make_state(number: int, mode: wire.Mode = "mission", stop: str = "") -> wire.State:
    """A state of this very moment."""
    return wire.State(
        tick=number, t_s=float(number), mono_ms=time.monotonic() * 1e3, mode=mode, stop=stop
    )
