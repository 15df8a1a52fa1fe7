"""The directions that a turning robot has shown its compass."""

from __future__ import annotations

import math

from agribot.autonomy.estimate.sensors.mag_fit import SECTORS, sector_of
from agribot.core.messages import SensorBatch


class Coverage:
    """Directions by the gyro from the start, as the fit at the end of the drive has them."""

    def __init__(self) -> None:
        self.seen = [False] * SECTORS
        self._turned_rad = 0.0
        self._last_t_s: float | None = None

    def add(self, batch: SensorBatch) -> None:
        for imu in batch.imu:
            if self._last_t_s is not None:
                self._turned_rad += imu.gyro_radps[2] * (imu.t_s - self._last_t_s)
            self._last_t_s = imu.t_s
        if batch.mag:
            self.seen[sector_of(math.pi / 2.0 - self._turned_rad)] = True
