"""Whether crop is seen where the robot believes its row to be: evidence that it drives this row."""

from __future__ import annotations

import math

from agribot.core.config import FieldConfig

# Way for which a sighting holds: the row in view, a gap in it, or the way to the next plant.
MEMORY_M, MEMORY_SPACINGS = 1.0, 1.5
SILENT_S = 2.0  # longest time without a picture while a camera looks


class RowSight:
    """Fed with pictures and with way; between them stands how much of both fitted the row."""

    def __init__(self, field: FieldConfig) -> None:
        self._memory_m = max(MEMORY_M, MEMORY_SPACINGS * (field.plant_spacing_m or 0.0))
        self._looked_s = -math.inf
        self._fitted = 0
        self._since_m = math.inf

    def observe(self, t_s: float, fitted: int) -> None:
        """Take a picture of time `t_s`; `fitted` counts what fitted the robot's row up to now."""
        self._looked_s = max(self._looked_s, t_s)
        if fitted > self._fitted:
            self._fitted, self._since_m = fitted, 0.0

    def move(self, distance_m: float) -> None:
        self._since_m += abs(distance_m)

    def is_seen(self, t_s: float) -> bool | None:
        """Whether the row is in view; None where no camera looks."""
        if t_s - self._looked_s > SILENT_S:
            return None
        return self._since_m <= self._memory_m
