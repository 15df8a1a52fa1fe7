"""The spot sprayer: a boom of nozzles."""

from __future__ import annotations

from typing import ClassVar

import msgspec

from agribot.core.config import Count, Positive
from agribot.core.implement.spec import ImplementSpec


class SprayerSpec(ImplementSpec, frozen=True, kw_only=True):
    """A boom of nozzles across the robot, each wetting a strip while it is open."""

    kind: ClassVar[str] = "sprayer"
    sections: ClassVar[str] = "nozzles"
    verb: ClassVar[str] = "sprayed"
    min_speed_mps: ClassVar[float] = 0.05  # slower, a nozzle would flood the spot below it
    wets_ground: ClassVar[bool] = True

    section_count: Count = msgspec.field(name="nozzle_count")
    section_spacing_m: Positive = msgspec.field(name="nozzle_spacing_m")
    section_width_m: Positive = msgspec.field(name="nozzle_width_m")
